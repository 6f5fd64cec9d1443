#pragma once

#include <string>
#include <vector>

#include "tools/imitate/smoother.hpp"
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

/// Reads logs as `tiller identify` does: CSV, records of runs, event logs. Each stretch without a gap is a
/// demonstration of its own. False with every reason in `error`: what a log lacks, one that is shorter than `least`
/// periods, one without an input that changes, and one that the model does not explain. What is odd goes to `warnings`.
bool read_demonstrations(const RobotFile& robot, const Scene& scene, const std::vector<std::string>& paths,
                         std::size_t least, std::vector<Demonstration>& all, std::vector<std::string>& warnings,
                         std::string& error);

}  // namespace tiller::tools::imitate
