#pragma once

#include <cstddef>

#include "scalar/isa.hpp"

// Code for lanes exists once per instruction set (tiller_isa_sources in CMake, which says TILLER_HAS_ISA_<name> to the
// target's other sources). A family of such code is a table of functions, `extern const Table kName` in each copy:
//
//     TILLER_DECLARE_COPIES(Table, kName)                                     // in namespace tiller
//     const Table& table() { return select_copy<Table>({TILLER_COPIES(kName)}); }

#ifdef TILLER_HAS_ISA_scalar
#define TILLER_ISA_scalar(X, ...) X(scalar, __VA_ARGS__)
#else
#define TILLER_ISA_scalar(X, ...)
#endif
#ifdef TILLER_HAS_ISA_sse2
#define TILLER_ISA_sse2(X, ...) X(sse2, __VA_ARGS__)
#else
#define TILLER_ISA_sse2(X, ...)
#endif
#ifdef TILLER_HAS_ISA_neon
#define TILLER_ISA_neon(X, ...) X(neon, __VA_ARGS__)
#else
#define TILLER_ISA_neon(X, ...)
#endif
#ifdef TILLER_HAS_ISA_avx2
#define TILLER_ISA_avx2(X, ...) X(avx2, __VA_ARGS__)
#else
#define TILLER_ISA_avx2(X, ...)
#endif
#ifdef TILLER_HAS_ISA_avx512
#define TILLER_ISA_avx512(X, ...) X(avx512, __VA_ARGS__)
#else
#define TILLER_ISA_avx512(X, ...)
#endif

/// X(isa, ...) for each instruction set of this build, worst first.
#define TILLER_FOR_BUILT_ISAS(X, ...)                                                               \
  TILLER_ISA_scalar(X, __VA_ARGS__) TILLER_ISA_sse2(X, __VA_ARGS__) TILLER_ISA_neon(X, __VA_ARGS__) \
      TILLER_ISA_avx2(X, __VA_ARGS__) TILLER_ISA_avx512(X, __VA_ARGS__)

#define TILLER_DECLARE_COPY(isa, Table, name) \
  inline namespace isa {                      \
  extern const Table name;                    \
  }
#define TILLER_DECLARE_COPIES(Table, name) TILLER_FOR_BUILT_ISAS(TILLER_DECLARE_COPY, Table, name)
#define TILLER_COPY(isa, name) {Isa::isa, &isa::name},
#define TILLER_COPIES(name) TILLER_FOR_BUILT_ISAS(TILLER_COPY, name)

namespace tiller {

template <class Table>
struct IsaCopy {
  Isa isa;
  const Table* table;
};

/// The best copy that is not above `best`, which this processor must run; the least where all are above. Copies stand
/// worst first.
template <class Table, std::size_t count>
const Table& select_copy(const IsaCopy<Table> (&copies)[count], Isa best = best_isa()) {
  const Table* chosen = copies[0].table;
  for (const IsaCopy<Table>& copy : copies)
    if (copy.isa <= best) chosen = copy.table;
  return *chosen;
}

}  // namespace tiller
