#pragma once

#include <cstdint>
#include <functional>
#include <istream>
#include <string>

#include "tools/logs/recorded_run.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

struct ReplayOptions {
  double tolerance = 0;             ///< of a command, in its unit; 0: to the last bit
  bool real_time = false;           ///< at the pace of the log
  double patience_s = 5;            ///< over LCM: wall time to wait for an answer
  std::string url, channel_prefix;  ///< over LCM
  /// Through a file: sees each tick of the replaying controller.
  std::function<void(const tiller_t* controller, const RecordEntry& entry, const tiller_info_t& info)> watch;
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

/// Whether they are the same to the last bit, or within the tolerance; `difference` becomes the larger of what it was
/// and the largest difference of an input.
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
