#include <limits>

#include "executive/executive.hpp"

namespace tiller {

tiller_status_t Executive::arm() {
  const tiller_status_t status = machine_.on(Event::arm);
  if (status == tiller_status_ok) recorder_.note_call(tiller_call_arm);
  return status;
}

tiller_status_t Executive::disarm() {
  const tiller_status_t status = machine_.on(Event::disarm);
  if (status != tiller_status_ok) return status;
  recorder_.note_call(tiller_call_disarm);
  info_.state = machine_.state();
  info_.first_fault = machine_.first_fault();
  return status;
}

tiller_status_t Executive::stop(tiller_status_t why) {
  const tiller_status_t reason = why == tiller_status_ok ? tiller_status_stopped : why;
  const tiller_status_t status = machine_.on(Event::stop, reason);
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
  motion_.clear();
  plan_.clear();
  timeline_.clear();
  timeline_.push(std::numeric_limits<std::int64_t>::min(), gate_.last());  // in force until the next one
  filters_run_ = false;
  hold_ticks_ = 0;
  unrenewed_plans_ = 0;
  info_.state = machine_.state();
  info_.first_fault = machine_.first_fault();
  return status;
}

/// The belief is that of the last plan: what changes until the next tick is the planner's business to correct.
void Executive::prepare() {
  if (planner_table_->prepare == nullptr || !was_moving_) return;
  recorder_.note_call(tiller_call_prepare);
  PlanRequest expected;
  expected.belief = &belief_.belief();
  expected.last_command = gate_.last();
  expected.tick = info_.ticks;
  expected.task_step = info_.ticks - task_tick_ + belief_.lead_periods();
  planner_table_->prepare(planner_, expected);
}

}  // namespace tiller
