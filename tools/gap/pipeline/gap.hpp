#pragma once

#include <vector>

#include "tools/gap/result/result.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Finds the gap between the robot file's model and the logs. Never throws; data that cannot be used give
/// Verdict::unfit with reasons. Deterministic. One core.
Result find_gap(const RobotFile& robot, const Options& options);
/// The same on logs that are in memory already: nothing is read, options.logs and options.hold_out do not count.
Result find_gap_in(const RobotFile& robot, const std::vector<Log>& logs, const std::vector<Log>& hold_out,
                   const Options& options);
/// The same on grids, for a configuration and its parameters' names.
Result find_gap_on(const tiller_config_t& config, const std::vector<std::string>& param_names, std::vector<Grid> work,
                   std::vector<Grid> hold_out, const Options& options);

}  // namespace tiller::tools::gap
