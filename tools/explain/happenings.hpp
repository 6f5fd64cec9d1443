#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tools/logs/recorded_run.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The kinds of what a run can show, the gravest first.
enum class HappeningKind : std::uint8_t {
  safe,      ///< the safe command was latched
  held,      ///< HOLD answered in the place of a plan
  refused,   ///< a measurement, or a plan, was not used; the plan before went on
  clipped,   ///< the gate cut the command
  late,      ///< the planner had less time than it wanted
  overran,   ///< the whole tick took longer than its deadline: what is not the planner's is not ended by it
  doubted,   ///< a plan was sent, and something about it is not as it should be
  missing,   ///< values of measurements were NaN, and skipped
  at_limit,  ///< the command stood at a limit, or changed as fast as it may
  ordinary   ///< nothing to worry about: the posterior takes in the data in steps
};

/// One reason for what ticks did: all ticks of the same kind, status and channel.
struct Happening {
  HappeningKind kind = HappeningKind::ordinary;
  tiller_status_t status = tiller_status_ok;
  std::size_t channel = 0;  ///< of kinds that are about one: the measurement, or twice the input (plus 1: its rate)
  std::size_t first = 0, last = 0;  ///< entries
  std::size_t ticks = 0;
  std::size_t spans = 0;  ///< stretches of neighbouring ticks
  double longest_s = 0;   ///< of kinds that are about the time of a tick
  std::string evidence;   ///< what the log shows at its first tick: a sentence
};

/// Of a plan, us; 0: none, as in simulated time.
double deadline_of(const tiller_config_t& config, const RecordedRun& run);

/// All that the ticks of a log tell, the gravest kinds first, each in the order of the log. `config` is the
/// controller's.
std::vector<Happening> find_happenings(const RobotFile& robot, const tiller_config_t& config, const RecordedRun& run);

/// Whether it is no trouble of the run.
bool is_remark(const Happening& happening);

}  // namespace tiller::tools
