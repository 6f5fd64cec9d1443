#pragma once

#include <cstddef>
#include <cstdint>
#include <new>
#include <type_traits>

namespace tiller {

/// Hands out pieces of one block, in order, never back. An arena without a base only measures: the same
/// layout function runs once to learn the size and once to place, so the two cannot disagree.
///
///     static Mppi* lay_out(Arena& a, const Config& c) {
///       auto* m = a.take<Mppi>(1);
///       auto* cost = a.take<float>(c.rollouts);  // (rollouts)
///       if (a.measuring()) return nullptr;
///       m->cost = cost;
///       return m;
///     }
///
/// Every piece starts on a cache line: lanes load aligned, and two pieces never share a line.
class Arena {
 public:
  static constexpr std::size_t kAlignment = 64;

  Arena() = default;
  Arena(void* base, std::size_t size) : base_(static_cast<unsigned char*>(base)), size_(size) {}

  bool measuring() const { return base_ == nullptr; }
  std::size_t used() const { return used_; }
  /// False once a piece did not fit; every later piece is then null.
  bool fits() const { return fits_; }

  /// `count` value-initialised objects; null while measuring, when the block is too small, and for none: the place
  /// behind the last piece is the next one's.
  template <class T>
  T* take(std::size_t count) {
    static_assert(std::is_trivially_destructible<T>::value, "nobody runs destructors in a block");
    static_assert(alignof(T) <= kAlignment, "raise kAlignment");
    const std::size_t at = used_;
    used_ += (count * sizeof(T) + kAlignment - 1) / kAlignment * kAlignment;
    if (measuring() || count == 0) return nullptr;
    if (used_ > size_) {
      fits_ = false;
      return nullptr;
    }
    T* first = reinterpret_cast<T*>(base_ + at);
    for (std::size_t i = 0; i < count; ++i) new (first + i) T();
    return first;
  }

 private:
  unsigned char* base_ = nullptr;
  std::size_t size_ = 0;
  std::size_t used_ = 0;
  bool fits_ = true;
};

}  // namespace tiller
