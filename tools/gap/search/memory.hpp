#pragma once

#include <cstddef>

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// Upper bound of what find_gap_on() holds on the heap at any time from here on, the logs' grids left out: known from
/// the windows, the candidates and kMostSets before anything is searched. A test counts what is taken.
std::size_t memory_bound(const Session& session);

}  // namespace tiller::tools::gap
