#pragma once

namespace tiller {

/// Instruction sets, worst first. Code for lanes is compiled once for each that the target has, every copy in
/// an inline namespace named after it, and chosen when the process starts.
enum class Isa { scalar = 0, sse2 = 1, neon = 2, avx2 = 3, avx512 = 4 };
constexpr int kIsaCount = 5;

/// The best that this processor and this build have; the environment variable TILLER_ISA (a name below) lowers
/// it, for tests and for comparisons. Reads the environment once.
Isa best_isa();
/// True if this build has copies for `isa` and this processor runs them.
bool has_isa(Isa isa);
const char* isa_name(Isa isa);

}  // namespace tiller

// Set by the build for sources that are compiled once per instruction set (tiller_isa_sources in CMake).
#if defined(TILLER_COMPILE_ISA)
#define TILLER_ISA_NAMESPACE_BEGIN \
  namespace tiller {               \
  inline namespace TILLER_COMPILE_ISA {
#define TILLER_ISA_NAMESPACE_END \
  }                              \
  }
#endif
