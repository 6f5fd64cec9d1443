#pragma once

#include "tools/gap/search/search.hpp"

namespace tiller::tools::gap {

/// Rollouts of 0.25, 1 and 3 s on the test windows before and after, remaining_sigma and the overlays.
void test_on_holdout(Session& session, const SearchResult& found, Result& result);

}  // namespace tiller::tools::gap
