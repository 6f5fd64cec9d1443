#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/logs/identify_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A measurement and the command that was in force from then on: what a row of a log for learning is made of, whatever
/// the format.
struct MeasuredRow {
  int line = 0;  ///< number of the message or tick, from 1
  std::int64_t stamp_us = 0;
  double measured[TILLER_MAX_MEASUREMENTS] = {};  // (ny) NaN: missing
  double input[TILLER_MAX_INPUTS] = {};           // (nu)
};

/// Adds a tick's measurement with the command that answers it. What was sent before the row before it is left out where
/// the sender begins to count anew.
void add_measured_row(int line, const tiller_measurement_t& measurement, const tiller_command_t& command,
                      std::vector<MeasuredRow>& rows);

/// The log of the rows; `what` names them in messages ("ticks with a measurement"), `path` the log. False with every
/// reason in `error`: fewer than 20 rows, stamps that do not rise.
bool make_log(const std::vector<MeasuredRow>& rows, const std::string& path, const char* what, const RobotFile& robot,
              Log& log, std::string& error);

}  // namespace tiller::tools
