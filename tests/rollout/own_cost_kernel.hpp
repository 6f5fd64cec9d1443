#pragma once

#include <vector>

#include "rollout/rollout.hpp"

namespace tiller {

#define TILLER_TEST_OWN_COST(isa)       \
  inline namespace isa {                \
  const RolloutTable& own_cost_table(); \
  }
#ifdef TILLER_TEST_HAS_scalar
TILLER_TEST_OWN_COST(scalar)
#endif
#ifdef TILLER_TEST_HAS_sse2
TILLER_TEST_OWN_COST(sse2)
#endif
#ifdef TILLER_TEST_HAS_neon
TILLER_TEST_OWN_COST(neon)
#endif
#ifdef TILLER_TEST_HAS_avx2
TILLER_TEST_OWN_COST(avx2)
#endif
#ifdef TILLER_TEST_HAS_avx512
TILLER_TEST_OWN_COST(avx512)
#endif

/// The cart-pole's kernels with a cost template, for every instruction set that this processor runs.
inline std::vector<const RolloutTable*> own_cost_tables() {
  std::vector<const RolloutTable*> tables;
#ifdef TILLER_TEST_HAS_scalar
  tables.push_back(&scalar::own_cost_table());
#endif
#ifdef TILLER_TEST_HAS_sse2
  if (has_isa(Isa::sse2)) tables.push_back(&sse2::own_cost_table());
#endif
#ifdef TILLER_TEST_HAS_neon
  tables.push_back(&neon::own_cost_table());
#endif
#ifdef TILLER_TEST_HAS_avx2
  if (has_isa(Isa::avx2)) tables.push_back(&avx2::own_cost_table());
#endif
#ifdef TILLER_TEST_HAS_avx512
  if (has_isa(Isa::avx512)) tables.push_back(&avx512::own_cost_table());
#endif
  return tables;
}

}  // namespace tiller
