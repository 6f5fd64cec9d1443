#include "scalar/isa.hpp"

#include <atomic>
#include <cstdlib>
#include <cstring>

namespace tiller {
namespace {

constexpr const char* kNames[kIsaCount] = {"scalar", "sse2", "neon", "avx2", "avx512"};

bool processor_has(Isa isa) {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_cpu_init();
  switch (isa) {
    case Isa::sse2: return __builtin_cpu_supports("sse2");
    case Isa::avx2: return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    case Isa::avx512:
      return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512cd") &&
             __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
             __builtin_cpu_supports("avx512vl");
    default: return isa == Isa::scalar;
  }
#else
  return isa == Isa::scalar || isa == Isa::neon;  // neon is part of aarch64
#endif
}

bool built(Isa isa) {
  // TILLER_BUILT_ISAS is the build's list, e.g. " sse2 avx2 avx512 "
  return std::strstr(TILLER_BUILT_ISAS, kNames[static_cast<int>(isa)]) != nullptr;
}

Isa choose() {
  int ceiling = kIsaCount - 1;
  if (const char* wish = std::getenv("TILLER_ISA"))
    for (int i = 0; i < kIsaCount; ++i)
      if (std::strcmp(wish, kNames[i]) == 0) ceiling = i;
  for (int i = ceiling; i > 0; --i)
    if (has_isa(static_cast<Isa>(i))) return static_cast<Isa>(i);
  // below every built copy: the least of them
  for (int i = 0; i < kIsaCount; ++i)
    if (has_isa(static_cast<Isa>(i))) return static_cast<Isa>(i);
  return Isa::scalar;
}

}  // namespace

bool has_isa(Isa isa) { return built(isa) && processor_has(isa); }

// Chosen once. A static of the function would bring a lock along, and with it the C++ library into programs in C; two
// threads that come first at once choose the same.
Isa best_isa() {
  static std::atomic<int> best{-1};
  int isa = best.load(std::memory_order_relaxed);
  if (isa < 0) {
    isa = static_cast<int>(choose());
    best.store(isa, std::memory_order_relaxed);
  }
  return static_cast<Isa>(isa);
}

const char* isa_name(Isa isa) { return kNames[static_cast<int>(isa)]; }

}  // namespace tiller
