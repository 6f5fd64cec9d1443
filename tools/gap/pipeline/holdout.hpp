#pragma once

#include "tools/gap/search/search.hpp"

namespace tiller::tools::gap {

/// Rollouts of 0.25, 1 and 3 s on the test windows by two models, remaining_sigma (of the second) and the overlays.
void test_on_holdout(Session& session, const Candidate& nominal, const Candidate& best, Result& result);

}  // namespace tiller::tools::gap
