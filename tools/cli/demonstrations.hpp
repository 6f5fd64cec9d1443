#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tools/logs/identify_data.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A stretch of a log without a gap, checked and smoothed.
struct Demonstration {
  Grid grid;                     ///< as measured, a point each period
  Eigen::MatrixXd state, input;  ///< (nx x steps + 1) and (nu x steps) as the model explains them
  double misfit = 0;  ///< RMS of the model's prediction errors in their own deviations; about 1 if the model fits
};

/// Reads logs as `tiller identify` does: CSV, records of runs, event logs. Parameters are at the centres of their
/// priors; of the process noise the part of the robot file's (1 to 0.01) is taken that explains the log best. False
/// with every reason in `error`: what a log lacks, one without a stretch of more than `least` periods, one without an
/// input that changes, one that the model does not explain. What is odd goes to `warnings`.
bool read_demonstrations(const RobotFile& robot, const Words& paths, std::size_t least, std::vector<Demonstration>& all,
                         Words& warnings, std::string& error);

/// What `tiller imitate` learns from, as JSON for the laboratory (python/tiller/labs/imitate). False with a sentence in
/// `error` for robots that it does not take too: quaternions, effects with states, delays, the LQR cost-to-go.
bool imitation_problem_json(const RobotFile& robot, const Words& paths, std::size_t least, std::string& json,
                            std::string& error);

}  // namespace tiller::tools
