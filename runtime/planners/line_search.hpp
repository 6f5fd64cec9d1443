#pragma once

#include "planners/path_plan.hpp"

namespace tiller {

// What `ilqr` and `sqp` share of choosing a step: candidates of one rollout, and the regularisation that follows from
// how far the best of them went.

/// Step lengths of the candidates, and how much of the gains each rolls with. The last two are the path's own inputs:
/// under the gains and as they are.
extern const double kStepAlpha[kCandidates];
extern const double kStepBeta[kCandidates];
constexpr std::uint32_t kWarmUnderGains = kCandidates - 2, kWarm = kCandidates - 1;

constexpr double kMostRaised = 1e6;     // regularisation where it is no use to go on
constexpr double kWeightsStand = 1e-9;  // of the risk: what moves less does not count
constexpr double kConverged = 1e-12;    // relative gain that ends the iterations
constexpr double kFlat = 1e-10;         // relative change of the cost that is rounding

/// More, or less, of the regularisation for the next problem; never below the configured one.
void raise_regularisation(PathPlan& p);
void lower_regularisation(PathPlan& p);

/// The path becomes the motion of the model from the start under its inputs; its risk, or infinity, and then the path
/// stays.
double roll_open(PathPlan& p);
/// The same, or under the old gains where the inputs alone cost twice as much: a pole that they let fall as soon as the
/// start, or a force, is not what they were made for. `chosen`: the candidate that was taken.
double roll_warm(PathPlan& p, std::uint32_t& chosen);

/// The proximal step of the risk's weights on the full step's costs; the largest change of a weight.
double weigh_full_step(PathPlan& p);

}  // namespace tiller
