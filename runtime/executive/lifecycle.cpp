#include <algorithm>
#include <limits>

#include "executive/executive.hpp"

namespace tiller {

tiller_status_t Executive::arm() {
  const tiller_status_t status = machine_.on(Event::arm);
  if (status == tiller_status_ok) recorder_.note_call(tiller_call_arm);
  return status;
}

/// The next motion starts again even where no tick has seen the robot stand still in between.
void Executive::end_motion() {
  if (probing_) probing_->end(info_);
  was_moving_ = false;
  motion_.clear();
}

tiller_status_t Executive::disarm() {
  const tiller_status_t status = machine_.on(Event::disarm);
  if (status != tiller_status_ok) return status;
  end_motion();
  recorder_.note_call(tiller_call_disarm);
  info_.state = machine_.state();
  info_.first_fault = machine_.first_fault();
  return status;
}

tiller_status_t Executive::stop(tiller_status_t why) {
  const tiller_status_t reason = why == tiller_status_ok ? tiller_status_stopped : why;
  const tiller_status_t status = machine_.on(Event::stop, reason);
  end_motion();
  recorder_.note_call(tiller_call_stop);
  info_.state = machine_.state();
  info_.first_fault = machine_.first_fault();
  return status;
}

tiller_status_t Executive::reset() {
  const tiller_status_t status = machine_.on(Event::reset);
  if (status != tiller_status_ok) return status;
  recorder_.note_call(tiller_call_reset);
  guard_.restart();
  posterior_->clear_adequacy();
  read_adequacy();
  end_motion();
  plan_.clear();
  forget_times();
  hold_ticks_ = 0;
  unrenewed_plans_ = 0;
  info_.state = machine_.state();
  info_.first_fault = machine_.first_fault();
  return status;
}

void Executive::note_goal() {
  ++goal_;
  steady_.clear();
  recorder_.note_call(tiller_call_goal);
}

void Executive::set_target(const double* target) {
  std::copy(target, target + config_.model->state_count, config_.cost.target);
  config_.cost.reference = nullptr;
  config_.cost.reference_steps = 0;
  note_goal();
}

void Executive::set_output_target(const double* target) {
  for (std::uint32_t j = 0; j < config_.cost.output_count; ++j) outputs_[j].target = target[j];
  config_.cost.output_reference = nullptr;
  config_.cost.output_reference_steps = 0;
  note_goal();
}

/// Row 0 of what is given is due at the next tick.
void Executive::set_reference(const double* states, const double* outputs, std::uint32_t steps) {
  config_.cost.reference = states;
  config_.cost.reference_steps = states ? steps : 0;
  config_.cost.output_reference = outputs;
  config_.cost.output_reference_steps = outputs ? steps : 0;
  task_tick_ = info_.ticks;
  note_goal();
}

tiller_status_t Executive::calibrate(const ProbeBox& box, std::uint32_t periods) {
  if (machine_.state() == tiller_state_safe) return tiller_status_wrong_state;
  probing_->calibrate(box, periods);
  info_.calibration_left = periods;
  recorder_.note_call(tiller_call_calibrate);
  return tiller_status_ok;
}

/// Every moment that was kept: stamps of a clock that has been set since would hold back all later ones.
void Executive::forget_times() {
  timeline_.clear();
  timeline_.push(std::numeric_limits<std::int64_t>::min(), gate_.last());  // in force until the next one
  filters_run_ = false;
}

/// The belief is that of the last plan: what changes until the next tick is the planner's business to correct.
void Executive::prepare() {
  if (planner_table_->prepare == nullptr || !was_moving_) return;
  recorder_.note_call(tiller_call_prepare);
  PlanRequest expected;
  expected.belief = &belief_.belief();
  aim(expected);
  expected.last_command = gate_.last();
  expected.tick = info_.ticks;
  expected.task_step = info_.ticks - task_tick_ + belief_.lead_periods();
  divergence_.weigh(prediction_, expected.task_step);
  planner_table_->prepare(planner_, expected);
}

}  // namespace tiller
