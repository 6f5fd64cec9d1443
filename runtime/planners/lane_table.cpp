#include "planners/lane_table.hpp"

namespace tiller {

#define TILLER_LANE_COPY(isa)           \
  namespace isa {                       \
  extern const LaneTable kPlannerLanes; \
  }
#ifdef TILLER_HAS_ISA_scalar
TILLER_LANE_COPY(scalar)
#endif
#ifdef TILLER_HAS_ISA_sse2
TILLER_LANE_COPY(sse2)
#endif
#ifdef TILLER_HAS_ISA_neon
TILLER_LANE_COPY(neon)
#endif
#ifdef TILLER_HAS_ISA_avx2
TILLER_LANE_COPY(avx2)
#endif
#ifdef TILLER_HAS_ISA_avx512
TILLER_LANE_COPY(avx512)
#endif
#undef TILLER_LANE_COPY

namespace {

// worst first
const LaneTable* const kCopies[] = {
#ifdef TILLER_HAS_ISA_scalar
    &scalar::kPlannerLanes,
#endif
#ifdef TILLER_HAS_ISA_sse2
    &sse2::kPlannerLanes,
#endif
#ifdef TILLER_HAS_ISA_neon
    &neon::kPlannerLanes,
#endif
#ifdef TILLER_HAS_ISA_avx2
    &avx2::kPlannerLanes,
#endif
#ifdef TILLER_HAS_ISA_avx512
    &avx512::kPlannerLanes,
#endif
};

}  // namespace

const LaneTable& select_lanes(Isa best) {
  const LaneTable* chosen = kCopies[0];
  for (const LaneTable* copy : kCopies)
    if (copy->isa <= best && has_isa(copy->isa)) chosen = copy;
  return *chosen;
}

}  // namespace tiller
