#pragma once

#include "tools/likelihood_free/inference.hpp"

namespace tiller::tools {

/// What makes a posterior doubtful though the method came to its end, as sentences in result.warnings:
///
/// - a parameter on the edge of its prior (tools/robot/prior_edge.hpp);
/// - one whose posterior is as wide as its prior, so that the logs say nothing of it;
/// - logs that the posterior's own simulations do not look like: 40 draws are simulated once more, and a channel's root
///   mean square distance from their mean exceeds four of their deviations. A simulator that explains the logs gives
///   about 1 (a posterior predictive check: Gelman, Meng, Stern, Statistica Sinica 1996).
///
/// Those simulations are added to result.found.simulations. False with the simulator's sentence in `error`.
bool add_doubts(const InferenceProblem& problem, Inferred& result, std::string& error);

}  // namespace tiller::tools
