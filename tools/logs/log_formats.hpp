#pragma once

#include <string>
#include <vector>

#include "tools/logs/identify_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Reads a log by what its first bytes say it is:
///   CSV with a header             columns and units of the robot file's [log], in the dialects of CsvReader
///   LCM event log (lcm-logger)    channels <prefix>MEASUREMENT and <prefix>COMMAND of [transport]
///                                 (docs/guide/lcm.md); values in the order of [measurement] and of the model's inputs,
///                                 SI units
///   record of `tiller run --record`    measurements and commands of every tick
///   MCAP of `tiller run --record`    the same ticks
///   ROS bags, ULog, other MCAP, MAT, NPZ, Parquet    columns of [log] by a tool of Python (read_channels_log); a ROS 2
///                                 bag may be its folder; "run.mat#2": one of its runs
/// In records and event logs a row is a measurement, and its input the command that was in force from then on: a
/// message's or tick's command that answers it. False with every reason in `error`.
bool read_any_log(const std::string& path, const RobotFile& robot, Log& log, std::string& error);

/// "csv", "lcm", "record", "mcap", "channels": by the first bytes; "csv" where nothing else fits.
std::string log_format(const std::string& path);

/// Of "run.mat#2" the file.
std::string log_file(const std::string& path);

}  // namespace tiller::tools
