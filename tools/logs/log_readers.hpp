#pragma once

#include <istream>
#include <string>
#include <vector>

#include "tools/logs/identify_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

// Readers of logs for learning: from a stream or bytes, so that nothing but the caller opens files. In the binary ones
// a row is a measurement, and its input the command that was in force from then on. `path` is for messages alone. False
// with every reason in `error`.

/// A CSV: read_log() without opening a file.
bool read_csv_log(std::istream& file, const std::string& path, const LogMap& map, const tiller_model_t& model,
                  const std::vector<int>& measured, Log& log, std::string& error);

/// An LCM event log: channels <prefix>MEASUREMENT and <prefix>COMMAND.
bool read_lcm_log(std::istream& file, const std::string& path, const RobotFile& robot, Log& log, std::string& error);

/// A record of `tiller run --record`.
bool read_record_log(std::istream& file, const std::string& path, const RobotFile& robot, Log& log, std::string& error);

/// An MCAP of `tiller run --record` (see is_mcap_run).
bool read_mcap_log(const std::string& bytes, const std::string& path, const RobotFile& robot, Log& log,
                   std::string& error);

}  // namespace tiller::tools
