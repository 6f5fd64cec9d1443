#pragma once

#include <cstdint>

namespace tiller {

/// The last `capacity` items of a sequence, over storage that somebody else owns. Items are named by their
/// position in the whole sequence (0 is the first ever pushed), so a reader can tell "gone" from "not yet".
template <class T>
class Ring {
 public:
  Ring() = default;
  Ring(T* storage, std::uint32_t capacity) : storage_(storage), capacity_(capacity) {}

  void clear() { end_ = 0; }
  /// The slot of the next item, to be filled in place; the oldest item is given up once the ring is full.
  T& push() { return storage_[end_++ % capacity_]; }

  std::uint32_t capacity() const { return capacity_; }
  std::uint64_t begin() const { return end_ > capacity_ ? end_ - capacity_ : 0; }
  std::uint64_t end() const { return end_; }
  std::uint32_t size() const { return static_cast<std::uint32_t>(end_ - begin()); }
  bool holds(std::uint64_t index) const { return index >= begin() && index < end_; }
  T& operator[](std::uint64_t index) { return storage_[index % capacity_]; }
  const T& operator[](std::uint64_t index) const { return storage_[index % capacity_]; }
  /// age 0 is the newest.
  const T& newest(std::uint32_t age = 0) const { return storage_[(end_ - 1 - age) % capacity_]; }

 private:
  T* storage_ = nullptr;
  std::uint32_t capacity_ = 0;
  std::uint64_t end_ = 0;
};

}  // namespace tiller
