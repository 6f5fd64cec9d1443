#pragma once

#include <functional>
#include <string>
#include <vector>

#include "io/lcm_messages.hpp"
#include "tools/links/arm_source.hpp"
#include "tools/links/goal_source.hpp"
#include "tools/logs/measured_rows.hpp"
#include "tools/logs/recorder.hpp"
#include "tools/robot/goals.hpp"
#include "tools/robot/posterior_file.hpp"
#include "tools/robot/robot_file.hpp"
#include "tools/run/realtime_run.hpp"

namespace tiller::tools {

struct RunOptions {
  /// Motion is permitted as soon as the drives are ready. Else the robot stands by until one of arm_sources decides.
  bool arm_at_once = true;
  std::vector<ArmSource*> arm_sources;  ///< may arm and disarm, in either case
  /// Robot time after the first measurement, and again after an arming by a source; 0: until Ctrl-C.
  double seconds = 0;
  unsigned threads = 1;
  bool quiet = false;
  RecorderOptions files;              ///< the run itself adds has_truth, goals, lossless and epoch_us
  bool real_time = false;             ///< the wall clock sets the pace: nothing waits for the disk
  double first_wait_s = 10;           ///< wall time to wait for the first measurement
  std::vector<Goal> goals;            ///< by time, counted like `seconds`; empty: the robot file's alone
  GoalSource* goal_source = nullptr;  ///< in their place: from whoever sends them
  /// The safe command is sent, and nothing is learnt, until every measured state has stood within four deviations of
  /// the start's ([start] state, sd and the sensor's) for half a second: somebody puts the robot back.
  bool await_start = false;
  bool keep_rows = false;  ///< RunResult::rows
  /// Sees every tick when its command is out, in the tick's thread: what it does, the next tick waits for.
  std::function<void(const tiller_t* controller, const LoggedTick& tick)> watch;
  bool calibrate = false;  ///< moves for learning alone, as [probe] says, before the task
};

/// The result of a run.
struct RunResult {
  int exit_code = 0;
  std::uint64_t ticks = 0;
  double time_s = 0;
  tiller_info_t info{};
  std::vector<double> q05, q95;         // (param_count) at the end
  std::vector<double> last_true_state;  // (nx) empty: not known
  Particles particles;                  ///< at the end
  MeasuredRows rows;                    ///< what was measured and commanded, where RunOptions::keep_rows asks for it
  std::uint64_t transitions = 0;        ///< ticks with a new measurement after the first
  double cost = 0;                      ///< mean stage_cost(), of the true states where they are known
  RecorderReport files;                 ///< what is in the logs
  LogState log;                         ///< of all logs, at the end
  PaceResult pace;
  std::uint64_t late_ticks = 0;                                  ///< over the planner's deadline, if it has one
  std::vector<double> contraction_ratio, contraction_direction;  // (d), (d x param_count): tiller_get_contraction
  bool interrupted = false;
  double inadequate_at_s = -1;  ///< robot time of the alarm; below zero: none
};

}  // namespace tiller::tools
