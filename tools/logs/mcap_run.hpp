#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/logs/mcap_writer.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

// A run as MCAP. Three topics, JSON with a JSON schema each, one message of each per tick, times those of the tick:
//
//   /measurement   stamp_us, sequence, command_latency_us and the measured states by name; only where there was one
//   /command       stamp_us, sequence, plan_sequence and the inputs by name
//   /tick          tick, now_us, status, planner_iterations, calls, ...; mean and sd: the estimate of state and
//   parameters; force: mean and sd of what pushes the joints beyond the model, and touched ([posterior] disturbance)
//
// Numbers are written so that they read back as the same double; NaN is null, infinity a text. The attachment
// `controller` is what a record file begins with (record_header), `robot.toml` the robot file: with them, `tiller
// replay` repeats the run to the last bit.

class McapRun {
 public:
  explicit McapRun(const RobotFile& robot) : robot_(robot) {}

  /// `epoch_us` is added to the ticks' time, so that logs of a real robot carry the time of day.
  void open(const std::string& path, const tiller_config_t& config, std::int64_t epoch_us);
  void add(const RecordEntry& entry);
  void flush() { writer_.flush(); }
  /// With what the recorder counted, as metadata `recorder`: ticks handed over, those among them that no log holds,
  /// which they are, and messages that this file lacks.
  bool close(std::uint64_t ticks, std::uint64_t dropped_ticks, const std::vector<LogHole>& holes = {});
  const McapWriter& writer() const { return writer_; }

 private:
  const RobotFile& robot_;
  McapWriter writer_;
  std::int64_t epoch_us_ = 0;
  std::uint16_t measurement_ = 0, command_ = 0, tick_ = 0;
};

/// Whether the bytes are of a run of tiller (else: an MCAP of somebody else, or none at all).
bool is_mcap_run(const std::string& bytes);

/// The robot file that the run was made with; empty: it holds none.
std::string robot_text_of(const std::string& mcap_bytes);

/// False with a message in `error` that begins with `path`. Names must be those of `robot`.
bool read_mcap_run(const std::string& bytes, const std::string& path, const RobotFile& robot, RecordedRun& run,
                   std::string& error);

}  // namespace tiller::tools
