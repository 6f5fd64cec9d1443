#pragma once

#include <string>
#include <vector>

#include "tools/logs/identify_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A log that Python packages read (tiller_tools.channels): ROS bags, ULog, MCAP of others, MAT, NPZ, Parquet. Of
/// messages, the columns of [log] are fields "topic.field", and each topic has stamps of its own:
///   a row is a stamp of a measured field; what others have within a hundredth of their typical step is the same row;
///   inputs keep the stamps of their messages.
/// False with every reason in `error`.
bool read_channels_log(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                       std::string& error);

}  // namespace tiller::tools
