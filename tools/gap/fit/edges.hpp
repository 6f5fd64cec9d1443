#pragma once

#include <vector>

#include "tools/gap/fit/shooting.hpp"
#include "tools/robot/prior_edge.hpp"

namespace tiller::tools::gap {

/// The edges of the priors on which the robot file's own free parameters stand, first in the order of the free ones: of
/// the normal whose centre is where the fit would go without bounds (one Newton step from where it is, zero but at a
/// bound) and whose deviations are `sd`, cut to the bounds. `names` (own_params).
std::vector<PriorEdge> prior_edges(const Hypothesis& hypothesis, const Fit& fit, const std::vector<double>& sd,
                                   const Words& names);

}  // namespace tiller::tools::gap
