#pragma once

#include "tools/gap/residual/fallback.hpp"
#include "tools/gap/result/result.hpp"
#include "tools/learn/held_out.hpp"
#include "tools/robot/robot_file.hpp"

// The robot's own parameters, fitted beside nine local weights: what forces stand on is unbiased by what the model
// lacks.

namespace tiller::tools::learn {

/// The fit of a residual with the largest evidence, at the joints of a machine of three at most. False where there is
/// none.
bool best_residual(const tiller_config_t& config, const std::vector<Grid>& grids, gap::ResidualFit& best);

/// The robot's own parameters as they stand beside the residual, with deviations; fixed ones as they are.
gap::Explanation own_params(const RobotFile& robot, const gap::ResidualFit& fit);

/// Rollouts with the nine weights at their mean.
HeldOut judge_residual(const gap::ResidualFit& fit, const std::vector<Grid>& grids,
                       const std::vector<Eigen::MatrixXd>& states);

}  // namespace tiller::tools::learn
