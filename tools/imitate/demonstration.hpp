#pragma once

#include <string>
#include <vector>

#include "tools/imitate/expansion.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools::imitate {

/// A log that was read, checked and smoothed.
struct Demonstration {
  std::string path;
  double first_time_s = 0;
  Grid grid;      ///< as measured, a point each period
  Motion motion;  ///< as the model explains it
  double misfit = 0;
  double limited = 0;  ///< share of the inputs that are at a limit
};

/// A logged motion as the model explains it (tools/smooth/smoother.hpp), from the grid's point `first` on. What one
/// sensor reads so tells of all states. The process noise is the part (1 to 0.01) of the robot file's that explains
/// the log best.
struct Smoothed {
  std::size_t first = 0;
  Motion motion;
  double misfit = 0;  ///< RMS of the prediction errors in their own deviations; about 1 if the model fits
};

/// The input of a period is the grid's. False with a sentence in `error` where a state is neither logged, nor the speed
/// of a logged position, nor in [start], and where the model runs away.
bool smooth_motion(const Scene& scene, const Grid& grid, Smoothed& result, std::string& error);

/// Reads logs as `tiller identify` does: CSV, records of runs, event logs. Each stretch without a gap is a
/// demonstration of its own. False with every reason in `error`: what a log lacks, one that is shorter than `least`
/// periods, one without an input that changes, and one that the model does not explain. What is odd goes to `warnings`.
bool read_demonstrations(const RobotFile& robot, const Scene& scene, const std::vector<std::string>& paths,
                         std::size_t least, std::vector<Demonstration>& all, std::vector<std::string>& warnings,
                         std::string& error);

}  // namespace tiller::tools::imitate
