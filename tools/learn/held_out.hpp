#pragma once

#include <vector>

#include "tools/smooth/forces.hpp"

namespace tiller::tools::learn {

/// How well rollouts of one second from filtered states meet the sensors, and whether their spread says so.
struct HeldOut {
  double rms_sigma = HUGE_VAL;  ///< error of the members' mean, in sensor deviations
  double covered = 0;           ///< share of readings at the end of a second within the central 90 % of the lanes
  std::size_t rollouts = 0;
  std::vector<double> squares;  ///< (rollouts) mean square error of each, in sensor deviations
  double seconds = 0;           ///< that the rollouts begin in: they overlap
};

/// A robot whose lanes are hypotheses: parameters, and white noise of the states beside them.
struct Hypotheses {
  const tiller_config_t* config = nullptr;
  std::vector<std::vector<double>> params;  ///< (hypotheses) of (np); they take the lanes in turn
  Eigen::VectorXd process_sd;               ///< (nx) per root second; drawn for the spread alone
};

/// Every quarter of a second of the grids one rollout, from `states` (nx x points) of each grid; NaN where none is
/// known. Lanes: 64. Cost: 64 rollouts of a second each.
HeldOut judge_rollouts(const Hypotheses& who, const std::vector<Grid>& grids,
                       const std::vector<Eigen::MatrixXd>& states);

/// Whether `after` is better in more rollouts than chance would have it: the share of rollouts that it improves, of as
/// many independent ones as there are seconds, is above a half by 1.64 deviations (one-sided 5 %).
bool is_better(const HeldOut& before, const HeldOut& after);

/// States of every point of the grids (nx x points) as a filter knows them there: the model at `params` with forces
/// that walk. What comes later has no say, or a rollout would begin with knowledge of its end.
std::vector<Eigen::MatrixXd> filtered_states(const tiller_config_t& config, const std::vector<Grid>& grids,
                                             const std::vector<double>& params, const Eigen::VectorXd& force_sd);

}  // namespace tiller::tools::learn
