#pragma once

#include <cstdint>
#include <istream>
#include <string>

#include "tools/recorded_run.hpp"
#include "tools/robot_file.hpp"

namespace tiller::tools {

/// Number of iterations that a log does not tell: the planner does what the configuration says.
constexpr std::uint32_t kIterationsUnknown = 0xffffffffu;

/// Reads what can be replayed, by its first bytes: a record, an MCAP or a CSV of `tiller run`, a log of LCM. False with a message
/// in `error`.
bool read_recorded_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error);

/// The text of the robot file that the log carries: an MCAP of `tiller run` does. Empty: none.
std::string robot_in_log(const std::string& path);

/// The ticks of an LCM log with measurements, commands and (where they were logged) telemetry. docs/replay.md tells what
/// is taken from where.
bool read_lcm_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error);
/// The same from a stream; `path` stands in errors.
bool read_lcm_run(std::istream& file, const std::string& path, const RobotFile& robot, RecordedRun& run,
                  std::string& error);

/// The ticks of a CSV of `tiller run --log`; `text` is the file's, `path` its name for messages. Like an LCM log, it does
/// not hold the configuration.
bool read_csv_run(const std::string& text, const std::string& path, const RobotFile& robot, RecordedRun& run,
                  std::string& error);

struct ReplayOptions {
  double tolerance = 0;             ///< of a command, in its unit; 0: to the last bit
  bool real_time = false;           ///< at the pace of the log
  double patience_s = 5;            ///< over LCM: wall time to wait for an answer
  std::string url, channel_prefix;  ///< over LCM
};

/// Where the two first differ.
struct Divergence {
  bool found = false;
  std::size_t at = 0;  ///< index of the entry
  tiller_command_t replayed{};
  tiller_info_t info{};  ///< of the replaying controller after that tick
  bool has_info = false;
  bool silent = false;  ///< over LCM: no answer came
};

struct ReplayResult {
  std::size_t ticks = 0;      ///< compared: those before the log's first hole
  std::size_t different = 0;  ///< commands that differ by more than the tolerance
  std::size_t behind = 0;     ///< ticks behind the first hole, which are replayed but not judged
  std::size_t behind_different = 0;
  double largest = 0;          ///< difference of any input
  Divergence first;            ///< command
  Divergence first_estimate;   ///< mean of the state, in any bit: seldom later than the command's
  std::size_t lost_calls = 0;  ///< ticks before which the host called more than the record keeps
};

/// Whether they are the same to the last bit, or within the tolerance; `difference` becomes the larger of what it was and
/// the largest difference of an input.
bool same_command(const tiller_command_t& a, const tiller_command_t& b, std::uint32_t inputs, double tolerance,
                  double& difference);

/// Whether the entry is behind the first hole; then the command is only counted.
bool is_behind_a_hole(const RecordedRun& run, std::size_t index, bool same, ReplayResult& result);

/// Feeds the recorded inputs to a fresh controller. False with a message: there is none to feed.
bool replay_through_file(const RobotFile& robot, RecordedRun& run, const ReplayOptions& options, ReplayResult& result,
                         std::string& error);

/// Publishes the recorded measurements over LCM and compares what a controller elsewhere answers, whatever computer it
/// is on. Not real time: the next measurement follows the answer.
bool replay_through_lcm(const RobotFile& robot, const RecordedRun& run, const ReplayOptions& options,
                        ReplayResult& result, std::string& error);

/// The first difference with the state at it, several lines; empty where there is none.
std::string divergence_text(const RobotFile& robot, const RecordedRun& run, const ReplayResult& result);

}  // namespace tiller::tools
