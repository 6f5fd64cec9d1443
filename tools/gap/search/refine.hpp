#pragma once

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// Fits entries of a screen to all working windows with the finest steps: all of them a few iterations, to the end
/// those that are not far behind the best one, or behind `ahead` (a total cost), and the best again from other shapes.
/// The others keep what they have: enough to build on.
void refine(Session& session, std::vector<Candidate>& entries, double ahead);

/// To the end, whatever it was fitted to before.
void fit_fully(Session& session, Candidate& entry);

}  // namespace tiller::tools::gap
