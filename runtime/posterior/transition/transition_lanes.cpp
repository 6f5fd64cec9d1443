#include "posterior/transition/transition_lanes.hpp"

#include "scalar/isa_copies.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(TransitionTable, kTransitionLanes)

const TransitionTable& transition_table() {
  static constexpr IsaCopy<TransitionTable> kCopies[] = {TILLER_COPIES(kTransitionLanes)};
  return select_copy(kCopies);
}

}  // namespace tiller
