#pragma once

#include <string>
#include <vector>

#include "tools/logs/recorded_run.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What is known of the sensors before a tick: the last value of each, and when it was read.
struct SensorMemory {
  bool started = false;
  std::vector<double> value;           // (measurements)
  std::vector<std::int64_t> stamp_us;  // (measurements) of the value
  std::int64_t last_us = 0;            ///< stamp of the last measurement that was taken in
  std::size_t last = 0;                ///< and its entry
  std::size_t repeats = 0;             ///< how often its values have repeated to the last bit

  void take(const RecordEntry& entry, std::size_t index, std::size_t count);
};

/// Name of an entry: "1.24 s (tick 62, line 64)", the line where the log is text.
std::string place_text(const RecordedRun& run, std::size_t index);

/// What the log shows of the reason of entry `index`, with the numbers of the robot file that it met; empty where it
/// shows no more than the reason's name. `before` is what came before that entry.
std::string evidence_of(const RobotFile& robot, const tiller_config_t& config, const RecordedRun& run,
                        std::size_t index, tiller_status_t status, const SensorMemory& before);

}  // namespace tiller::tools
