#include "tools/run/run_task.hpp"

#include <algorithm>
#include <cmath>

#include "tools/robot/stage_cost.hpp"

namespace tiller::tools {

RunTask::RunTask(Config& config, const RunOptions& options) : config_(config), options_(options) {
  for (std::uint32_t j = 0; j < config.cost.output_count; ++j) output_target_[j] = config.cost.outputs[j].target;
}

std::uint32_t RunTask::goal_kinds() const {
  std::uint32_t kinds = 0;
  if (options_.goal_source) kinds = kGoalStates | (config_.cost.output_count > 0 ? kGoalOutputs : 0);
  for (const Goal& goal : options_.goals)
    kinds |= (goal.states.empty() ? 0 : kGoalStates) | (goal.outputs.empty() ? 0 : kGoalOutputs);
  return kinds;
}

void RunTask::set(tiller_t* controller, const Goal& goal, RecordEntry& entry) {
  if (!goal.states.empty() && tiller_set_target(controller, goal.states.data()) == tiller_status_ok) {
    std::copy(goal.states.begin(), goal.states.end(), config_.cost.target);
    entry.goal |= kGoalStates;
  }
  if (!goal.outputs.empty() && tiller_set_output_target(controller, goal.outputs.data()) == tiller_status_ok) {
    std::copy(goal.outputs.begin(), goal.outputs.end(), output_target_);
    entry.goal |= kGoalOutputs;
  }
}

void RunTask::pursue(tiller_t* controller, bool begun, double task_s, RecordEntry& entry) {
  const std::vector<Goal>& goals = options_.goals;
  std::size_t due = next_goal_;
  while (begun && due < goals.size() && goals[due].time_s <= task_s) ++due;
  if (due > next_goal_) set(controller, goals[due - 1], entry);
  next_goal_ = due;
  Goal told;
  if (options_.goal_source && options_.goal_source->poll(told)) set(controller, told, entry);
  std::copy_n(config_.cost.target, config_.model->state_count, entry.target);
  std::copy_n(output_target_, config_.cost.output_count, entry.output_target);
}

void RunTask::count(const LoggedTick& tick) {
  if (tick.info.state == tiller_state_standby) return;
  double x[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < config_.model->state_count; ++i) {
    const bool known = tick.has_truth && std::isfinite(tick.true_state[i]);
    x[i] = known ? tick.true_state[i] : tick.info.state_mean[i];
  }
  const auto step = clock_.step(tick.info.ticks - 1, static_cast<tiller_state_t>(tick.info.state)).value_or(0);
  const tiller_record_t& record = tick.entry.record;
  const double cost = stage_cost(config_, step, x, record.command.value, tick.info.param_mean, output_target_);
  cost_ += (cost - cost_) / static_cast<double>(++costed_);
  if (record.has_measurement != 0 && costed_ > 1) ++transitions_;
}

}  // namespace tiller::tools
