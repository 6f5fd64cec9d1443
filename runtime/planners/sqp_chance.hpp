#pragma once

#include "planners/sqp_program.hpp"

namespace tiller {

struct ScenarioTree;

// Chance constraints of sqp: hard bounds stand back by a quantile of the predicted spread, so that the motion ahead
// leaves them, anywhere, with the probability asked for. The spread is that of a robot that is measured and steered
// along the path (predicted_spread.hpp): without the feedback an unstable one would leave no room between its bounds.

/// Whether the configuration asks for them: cost.bound_risk.
bool wants_margins(const tiller_config_t& config);

struct SpreadRoom {
  double quantile = 0.0;   // of the spread where every state has an equal share of the risk, in deviations
  double* work = nullptr;  // covariances, a gain and scratch of one path
  // of forces that wander, where the setup has some
  double* push = nullptr;    // (N x M x nz x forces) d next / d force along the path
  double* next = nullptr;    // (2 x N x M x nz) with the force one way and the other
  double* params = nullptr;  // (M x np) with it
};
void lay_out_spread_room(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const PathPlan& p,
                         SpreadRoom& room);

/// (N+1 x M x nx) by how much nearer the bounds stand at each state of the linearised path, under its gains. Zeros
/// without a belief that knows its spread.
void predict_margins(const PathPlan& p, const HardBounds& bounds, const SpreadRoom& room, double* margin);
/// The same (N+1 x nx) of branch j, which answers with the trunk's gains first and with its own behind it.
void predict_branch_margins(const ScenarioTree& tree, std::uint32_t j, const HardBounds& bounds, const SpreadRoom& room,
                            double* margin);

}  // namespace tiller
