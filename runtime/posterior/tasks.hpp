#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Particles from which on a single filter step is worth the cost of waking threads (about 10 us).
constexpr std::uint32_t kWorthThreads = 1024;

/// Runs fn(0..count-1) through the caller's parallel_for, or as a loop where there is none or `parallel` is false.
/// The chunks are independent and of fixed content, so neither choice changes a bit.
template <class Fn>
void for_each_chunk(const tiller_hooks_t* hooks, std::uint32_t count, bool parallel, const Fn& fn) {
  if (!parallel || count < 2 || !hooks || !hooks->parallel_for) {
    for (std::uint32_t i = 0; i < count; ++i) fn(i);
    return;
  }
  hooks->parallel_for(
      hooks->context, count, [](void* arg, std::uint32_t index) { (*static_cast<const Fn*>(arg))(index); },
      const_cast<Fn*>(&fn));
}

}  // namespace tiller
