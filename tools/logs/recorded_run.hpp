#pragma once

#include <cstdint>
#include <istream>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/logs/log_holes.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A run that was read back from a log.
struct RecordedRun {
  bool has_config = false;  ///< `config` and `joint` are what the controller was made from
  Config config{};
  std::shared_ptr<const JointPrior> joint;
  std::vector<RecordEntry> entries;
  std::vector<LogHole> holes;  ///< what is missing among them, in their order
  std::string note;            ///< what of the file is missing or could not be read; empty: nothing
  bool cut_off = false;        ///< the file ends early, is damaged or has holes
  std::size_t first_line = 0;  ///< of a text with a line for each tick: that of the first one
  double deadline_us = std::numeric_limits<double>::quiet_NaN();  ///< of a plan; 0: none; NaN: not told
};

/// Adds the ticks that the entries' numbers leave out to the holes that a reader has found, and tells of all in the
/// note.
void find_holes(RecordedRun& run);

/// How many ticks can be judged: those before the first hole, where the controller knew what the log tells.
std::size_t sound_ticks(const RecordedRun& run);

/// Number of iterations that a log does not tell: the planner does what the configuration says.
constexpr std::uint32_t kIterationsUnknown = 0xffffffffu;

/// State of a command whose log does not tell the controller's.
constexpr std::uint32_t kStateUnknown = 0xffffffffu;

/// Reads what can be replayed, by its first bytes: a record, an MCAP or a CSV of `tiller run`, a log of LCM; of any
/// other log that read_any_log() takes, its rows. False with a message in `error`.
bool read_recorded_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error);

/// The text of the robot file that the log carries: an MCAP of `tiller run` does. Empty: none, or the log cannot be
/// read; then `error` tells why.
std::string robot_in_log(const std::string& path, std::string& error);

/// The ticks of an LCM log with measurements, commands and (where they were logged) telemetry. docs/guide/replay.md
/// tells what is taken from where.
bool read_lcm_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error);
/// The same from a stream; `path` stands in errors.
bool read_lcm_run(std::istream& file, const std::string& path, const RobotFile& robot, RecordedRun& run,
                  std::string& error);

/// The ticks of a CSV of `tiller run --log`; `path` stands in errors. Like an LCM log, it does not hold the
/// configuration.
bool read_csv_run(std::istream& file, const std::string& path, const RobotFile& robot, RecordedRun& run,
                  std::string& error);

}  // namespace tiller::tools
