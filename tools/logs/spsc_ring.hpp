#pragma once

#include <atomic>
#include <cstddef>
#include <vector>

namespace tiller::tools {

/// A queue from one thread to one other, of a size that is fixed when it is made; neither side ever waits for the
/// other. Every page of it is touched at once, so that none is fetched in a tick.
template <class T>
class SpscRing {
 public:
  explicit SpscRing(std::size_t capacity) : slots_(capacity + 1) {}

  /// The writer's: false where the ring is full, and nothing was taken.
  bool push(const T& item) {
    const std::size_t end = end_.load(std::memory_order_relaxed);
    const std::size_t next = after(end);
    if (next == begin_.load(std::memory_order_acquire)) return false;
    slots_[end] = item;
    end_.store(next, std::memory_order_release);
    return true;
  }

  /// The reader's: the oldest item, null where there is none. It stays until pop().
  const T* front() const {
    const std::size_t begin = begin_.load(std::memory_order_relaxed);
    return begin == end_.load(std::memory_order_acquire) ? nullptr : &slots_[begin];
  }
  void pop() { begin_.store(after(begin_.load(std::memory_order_relaxed)), std::memory_order_release); }

  std::size_t capacity() const { return slots_.size() - 1; }

 private:
  std::size_t after(std::size_t i) const { return i + 1 == slots_.size() ? 0 : i + 1; }

  std::vector<T> slots_;  // one is always empty: full and empty differ
  alignas(64) std::atomic<std::size_t> begin_{0};
  alignas(64) std::atomic<std::size_t> end_{0};
};

}  // namespace tiller::tools
