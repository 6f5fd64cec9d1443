#pragma once

#include <cstdint>

#include "tools/robot/task_clock.hpp"
#include "tools/run/run_result.hpp"

namespace tiller::tools {

/// The task of a run: which goals are in force, and what the ticks have cost.
class RunTask {
 public:
  /// `config.cost.target` becomes the target in force.
  RunTask(Config& config, const RunOptions& options);

  /// kGoalStates, kGoalOutputs: what this run may set.
  std::uint32_t goal_kinds() const;
  /// The goals by time begin anew.
  void begin() { next_goal_ = 0; }
  /// Before a tick: sets the goal that is due `task_s` after the begin, if it is not the one in force. Without `begun`
  /// none by time is due.
  void pursue(tiller_t* controller, bool begun, double task_s, RecordEntry& entry);
  /// After it.
  void count(const LoggedTick& tick);
  double mean_cost() const { return cost_; }
  /// Ticks with a new measurement after the first.
  std::uint64_t transitions() const { return transitions_; }

 private:
  void set(tiller_t* controller, const Goal& goal, RecordEntry& entry);

  Config& config_;
  const RunOptions& options_;
  std::size_t next_goal_ = 0;
  double output_target_[TILLER_MAX_OUTPUTS] = {};  // in force
  TaskClock clock_;
  std::uint64_t costed_ = 0, transitions_ = 0;
  double cost_ = 0;
};

}  // namespace tiller::tools
