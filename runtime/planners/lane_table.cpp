#include "planners/lane_table.hpp"

#include "scalar/isa_copies.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(LaneTable, kPlannerLanes)

const LaneTable& select_lanes(Isa best) {
  static constexpr IsaCopy<LaneTable> kCopies[] = {TILLER_COPIES(kPlannerLanes)};
  return select_copy(kCopies, best);
}

}  // namespace tiller
