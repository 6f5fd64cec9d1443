#include "executive/executive.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {
namespace {

bool is_fault(tiller_status_t status) { return status >= 1 && status < 200; }

/// Whether an update that returned this took the measurement in.
bool taken(tiller_status_t status) { return !is_fault(status) && status != tiller_status_measurement_outlier; }

bool all_finite(const double* values, std::uint32_t count) {
  return std::all_of(values, values + count, [](double v) { return std::isfinite(v); });
}

}  // namespace

void Executive::Tick::note(tiller_status_t reason) {
  if (status == tiller_status_ok || (is_fault(reason) && !is_fault(status))) status = reason;
}

tiller_status_t Executive::tick(std::int64_t now_us, const tiller_measurement_t* measurement,
                                tiller_command_t& command) {
  Tick tick = begin_tick(now_us, measurement);
  sense(tick);
  learn(tick);
  watch_motion(tick);
  plan(tick);
  gate(tick, command);
  note_adequacy(tick);
  record(tick, command);
  keep_reserve(tick);
  return static_cast<tiller_status_t>(info_.status);
}

/// The deadline is the tick's: the planner's ends earlier by what the way back from a rollout, the gate and the record
/// take. 127 of 128 ticks take less: up by 127/128 of a step after one that takes more, else down by 1/128. A step is a
/// sixteenth, so that what the machine steals once takes little from all ticks after it. A plan without an iteration
/// needs that time more: a deadline that is kept by having no plan is none.
void Executive::keep_reserve(const Tick& tick) {
  if (tick.planned_ns == 0 || config_.planner.deadline_us == 0) return;
  if (tick.iterations == 0) return void(reserve_ns_ /= 2);
  const std::int64_t took_ns = clock_ns() - tick.planned_ns + tick.late_ns;
  const std::int64_t most_ns = std::int64_t{config_.planner.deadline_us} * 500;
  if (reserve_ns_ == 0) reserve_ns_ = std::min(took_ns, most_ns / 4);
  const std::int64_t step_ns = reserve_ns_ / 16 + 128;
  reserve_ns_ += took_ns > reserve_ns_ ? step_ns - step_ns / 128 : -(step_ns / 128);
  reserve_ns_ = std::clamp<std::int64_t>(reserve_ns_, 1, most_ns);
}

Executive::Tick Executive::begin_tick(std::int64_t now_us, const tiller_measurement_t* measurement) {
  Tick tick;
  tick.now_us = now_us;
  tick.start_ns = clock_ns();
  tick.measurement = measurement;
  const bool first = info_.ticks == 0;
  tick.elapsed_s = first ? config_.period_s : static_cast<double>(elapsed_us(now_us, last_now_us_)) * 1e-6;
  last_now_us_ = now_us;
  info_.posterior_ns = info_.plan_ns = 0;
  return tick;
}

// ---- sense and validate --------------------------------------------------------------------------------

void Executive::sense(Tick& tick) {
  const SensorVerdict verdict = guard_.check(tick.now_us, tick.measurement);
  tick.usable = verdict.usable;
  tick.note(verdict.status);
  // whoever stands still has nothing that depends on the old time; in motion, and in SAFE until the reset, it stands
  if (verdict.clock_set && standing_by()) {
    guard_.forget_readings();
    forget_times();
    (void)machine_.on(Event::clock_set);
  }
  // in motion nothing may have been expired, not even if good readings are back; at rest nobody is hurt by a pause
  const bool paused = verdict.expired && moving();
  if (paused) tick.note(tiller_status_sensor_stale);
  if (verdict.usable) machine_.on_measurement();
  if (verdict.lost || paused)
    (void)machine_.on(Event::sensor_fault, verdict.lost ? verdict.status : tiller_status_sensor_stale);
  info_.rejected_measurements = guard_.rejected();
  info_.missing_values = guard_.missing();
}

// ---- learn -----------------------------------------------------------------------------------------------

void Executive::learn(Tick& tick) {
  // in SAFE the drive may be off, or somebody may be pushing the robot: nothing to learn from
  if (!tick.usable || machine_.state() == tiller_state_safe) {
    tick.usable = false;
    return;
  }
  const std::int64_t start_ns = clock_ns();
  const tiller_status_t status = update_belief(tick);
  tick.note(status);
  if (!taken(status)) note_untaken(tick, status);
  read_posterior(tick);
  if (!tick.usable) watch_age(tick);
  info_.posterior_ns = clock_ns() - start_ns;
}

tiller_status_t Executive::update_belief(Tick& tick) {
  const tiller_measurement_t& m = *tick.measurement;
  tick.period_s = static_cast<double>(elapsed_us(m.stamp_us, stamp_us_)) * 1e-6;
  const std::int64_t begin_us = stamp_us_;
  stamp_us_ = m.stamp_us;
  sequence_ = m.sequence;
  const std::int64_t age_us = elapsed_us(tick.now_us, m.stamp_us);
  // bounded, for the measurement comes from outside: a latency of an hour, told once, would put this command an hour
  // ahead, and until then the timeline would believe none of those that follow
  const std::int64_t most_us = std::llround(kLongestLead_periods * config_.period_s * 1e6);
  actuation_latency_us_ = std::clamp<std::int64_t>(elapsed_us(m.command_latency_us, age_us), 0, most_us);

  // nobody knows what moved a robot that stands by: its drive is off, and a hand may push it
  if (!driven_) filters_run_ = false;
  if (!filters_run_ || tick.period_s > kLongestGap_periods * config_.period_s) return restart_filters(tick);
  const tiller_status_t status = bridge(tick, begin_us);
  if (!taken(status)) return status;
  untaken_ = 0;
  estimate_us_ = m.stamp_us;
  return status;
}

/// The state estimate begins at this measurement and stands on it. No model has been tried on it yet: a count of
/// updates that took nothing in goes on.
tiller_status_t Executive::restart_filters(Tick& tick) {
  if (filters_run_) ++info_.posterior_failures;
  tick.restarted = true;
  const tiller_status_t status = posterior_->start(tick.measurement->value);
  filters_run_ = status == tiller_status_ok;
  if (filters_run_) estimate_us_ = stamp_us_;
  return status;
}

/// Periods that went by without a measurement, each under the commands that were in force in it, then the one that ends
/// with this tick's.
tiller_status_t Executive::bridge(const Tick& tick, std::int64_t begin_us) {
  const auto pieces = static_cast<std::uint32_t>(std::max(1.0, std::round(tick.period_s / config_.period_s)));
  Transition transition;
  transition.period_s = tick.period_s / pieces;
  for (std::uint32_t k = 0; k < pieces; ++k) {
    const double from_s = k * transition.period_s;
    const bool last = k + 1 == pieces;
    timeline_.mean(begin_us, from_s, last ? tick.period_s : from_s + transition.period_s, transition.input);
    if (last) break;
    const tiller_status_t status = posterior_->skip(transition);
    if (is_fault(status)) return status;
  }
  const double* value = tick.measurement->value;
  std::copy(value, value + config_.measurement_count, transition.measured);
  return posterior_->update(transition);
}

/// The estimate does not stand on this measurement, so nothing is planned from it. A doubted one leaves a prediction;
/// after a fault the filters start again with the next measurement, but not for ever.
void Executive::note_untaken(Tick& tick, tiller_status_t why) {
  tick.usable = false;
  if (!is_fault(why)) return;
  ++info_.posterior_failures;
  filters_run_ = false;
  if (untaken_ < kLongest) ++untaken_;
  if (untaken_ >= config_.safety.bad_ticks_to_safe) (void)machine_.on(Event::sensor_fault, why);
}

/// Sensors that speak are no better than silent ones while the estimate does not follow them: neither a plan nor HOLD
/// may feed back from it for longer.
void Executive::watch_age(Tick& tick) {
  const auto timeout_us = static_cast<std::int64_t>(std::llround(config_.safety.sensor_timeout_s * 1e6));
  if (!moving() || elapsed_us(tick.now_us, estimate_us_) <= timeout_us) return;
  (void)machine_.on(Event::sensor_fault, tick.status);
}

void Executive::read_posterior(Tick& tick) {
  posterior_->moments(info_.param_mean, info_.param_sd, info_.state_mean, info_.state_sd);
  info_.effective_samples = posterior_->effective_samples();
  info_.likelihood_exponent = posterior_->exponent();
  info_.noise_scale = posterior_->noise_scale();
  info_.acceptance = posterior_->acceptance();
  info_.resamplings = posterior_->resamplings();
  read_adequacy();
  read_forces();
  origin_.follow(info_.state_mean);
  posterior_->set_origin(origin());
  if (all_finite(info_.state_mean, config_.model->state_count)) return;
  // nothing can be planned from this; the next measurement restarts the filters
  tick.note(tiller_status_state_not_finite);
  if (filters_run_) note_untaken(tick, tiller_status_state_not_finite);
}

void Executive::read_adequacy() {
  PosteriorReport report;
  posterior_->report(report);
  std::copy(report.noise_sd, report.noise_sd + TILLER_MAX_STATES, info_.noise_sd);
  std::copy(report.delay_weight, report.delay_weight + TILLER_MAX_HYPOTHESES, info_.delay_weight);
  std::copy(report.forgetting_weight, report.forgetting_weight + TILLER_MAX_FORGETTING, info_.forgetting_weight);
  std::copy(report.drift_evidence, report.drift_evidence + TILLER_MAX_DRIFTS, info_.drift_evidence);
  std::copy(report.jump_evidence, report.jump_evidence + TILLER_MAX_DRIFTS, info_.jump_evidence);
  std::copy(report.jump_age_s, report.jump_age_s + TILLER_MAX_DRIFTS, info_.jump_age_s);
  std::copy(report.jump_by, report.jump_by + TILLER_MAX_DRIFTS, info_.jump_by);
  info_.discrepancy_share = report.discrepancy_share;
  info_.relearned = report.relearned;
  info_.lost_transitions = report.lost;
  const AdequacyTest* test = posterior_->adequacy();
  if (test == nullptr) return;
  info_.adequacy = test->state();
  info_.inadequate_channel = test->channel();
  info_.inadequate_feature = test->feature();
  info_.adequacy_statistic = test->statistic();
}

void Executive::read_forces() {
  if (info_.slip_states != 0) read_slips();
  if (info_.force_joints == 0) return;
  (void)posterior_->forces(0.0, info_.force_mean, info_.force_sd);
  const Posterior::Friction friction = posterior_->friction();
  std::copy(friction.viscous, friction.viscous + TILLER_MAX_JOINTS, info_.viscous_mean);
  std::copy(friction.viscous_sd, friction.viscous_sd + TILLER_MAX_JOINTS, info_.viscous_sd);
  std::copy(friction.dry, friction.dry + TILLER_MAX_JOINTS, info_.dry_mean);
  std::copy(friction.dry_sd, friction.dry_sd + TILLER_MAX_JOINTS, info_.dry_sd);
  double mean[TILLER_MAX_JOINTS] = {}, sd[TILLER_MAX_JOINTS] = {};
  posterior_->contacts(mean, sd);
  info_.touched = contact_.judge(info_.force_joints, mean, sd);
  if (info_.touched != 0 && moving() && config_.safety.contact_action == tiller_contact_safe)
    (void)machine_.on(Event::stop, tiller_status_contact);
}

void Executive::read_slips() {
  double mean[TILLER_MAX_JOINTS] = {}, sd[TILLER_MAX_JOINTS] = {};
  (void)posterior_->forces(0.0, mean, sd);
  for (std::uint32_t i = 0, slip = 0; i < config_.model->state_count; ++i) {
    if (((info_.slip_states >> i) & 1u) == 0) continue;
    info_.slip_mean[i] = mean[slip];
    info_.slip_sd[i] = sd[slip++];
  }
}

/// Last of all reasons: the command is a fresh plan like any other, made with a model that is known to be wrong.
void Executive::note_adequacy(Tick& tick) const {
  if (info_.adequacy == tiller_adequacy_inadequate) tick.note(tiller_status_model_inadequate);
}

// ---- frozen sensors --------------------------------------------------------------------------------------

void Executive::watch_motion(Tick& tick) {
  const std::uint32_t window = config_.safety.frozen_ticks;
  if (window == 0 || !tick.usable) return;
  const bool fresh = guard_.repeats() == 0 || tick.restarted;
  if (fresh || !moving() || !motion_.begun()) {
    begin_motion_check();
    return;
  }
  step_motion(tick);
  if (motion_.steps() < window) return;
  if (!guard_.frozen(motion_.should_move())) {
    begin_motion_check();
    return;
  }
  tick.note(tiller_status_sensor_frozen);
  tick.usable = false;
  (void)machine_.on(Event::sensor_fault, tiller_status_sensor_frozen);
}

void Executive::begin_motion_check() {
  double state[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i) state[i] = info_.state_mean[i] - origin()[i];
  motion_.begin(*posterior_, info_.ticks, state, info_.state_sd);
}

void Executive::step_motion(const Tick& tick) {
  const std::uint32_t nu = config_.model->input_count;
  double input[TILLER_MAX_INPUTS], before[TILLER_MAX_INPUTS];
  timeline_.mean(stamp_us_, -tick.period_s, 0.0, input);
  for (std::uint32_t row = 0; row < setup_.delay_steps; ++row) {
    const double end_s = -tick.period_s - row * config_.period_s;
    timeline_.mean(stamp_us_, end_s - config_.period_s, end_s, before);
    for (std::uint32_t i = 0; i < nu; ++i) history_[row * nu + i] = static_cast<float>(before[i]);
  }
  motion_.step(tick.period_s, input, history_);
}

// ---- plan ------------------------------------------------------------------------------------------------

void Executive::plan(Tick& tick) {
  tick.iterations = 0;
  info_.probing = tiller_probing_none;
  if (moving()) {
    if (!was_moving_) enter_motion();
    const std::int64_t start_ns = clock_ns();
    if (tick.usable) {
      replan(tick);
    } else {
      continue_plan(tick);
    }
    info_.plan_ns = clock_ns() - start_ns;
  }
  count_hold(tick);
  if (probing_) pass_probing();
  was_moving_ = moving();
  forced_iterations_ = kNotForced;
}

/// Motion begins: what was planned before the robot stood still is no warm start.
void Executive::enter_motion() {
  planner_table_->reset(planner_);
  plan_.clear();
  prediction_.clear();
  divergence_.clear();
  steady_.clear();
  if (probing_) probing_->begin(info_);
  unrenewed_plans_ = 0;
  task_tick_ = info_.ticks;
}

void Executive::replan(Tick& tick) {
  const double ahead_s = static_cast<double>(elapsed_us(effective_at_us(tick), stamp_us_)) * 1e-6;
  const double bounded_s = std::min(ahead_s, kLongestLead_periods * config_.period_s);
  belief_.draw(*posterior_, timeline_, info_.ticks, stamp_us_, bounded_s);

  PlanRequest request;
  request.belief = &belief_.belief();
  if (!steady_.stands()) steady_.update(*posterior_, info_.param_mean, info_.state_mean);
  aim(request);
  request.last_command = gate_.last();
  request.tick = info_.ticks;
  request.task_step = info_.ticks - task_tick_ + belief_.lead_periods();
  request.doubted = info_.adequacy == tiller_adequacy_inadequate;
  request.deadline = deadline(tick);
  request.param_mean = info_.param_mean;
  request.param_sd = info_.param_sd;
  divergence_.weigh(prediction_, request.task_step);
  const std::int64_t due_ns = std::max(clock_ns(), request.deadline.deadline_ns);  // no planner ends before it began
  const PlanResult result = planner_table_->plan(planner_, request, tick.wanted);
  tick.planned_ns = clock_ns();
  if (request.deadline.deadline_ns != 0) tick.late_ns = std::max<std::int64_t>(tick.planned_ns - due_ns, 0);
  // what was begun counts where it failed: a replay that stops short of it would not fail
  const bool refused = is_fault(result.status) && (result.refused || result.iterations == 0);
  tick.iterations = result.iterations + (refused ? 1 : 0);
  config_.posterior.moves_per_tick = moves_given_.after_plan(tick.iterations == 0);
  info_.plan_cost = result.cost + divergence_.rest();
  info_.plan_lead = belief_.lead_periods();

  if (is_fault(result.status)) return fail_plan(tick, result.status);
  if (!all_finite(tick.wanted, config_.model->input_count)) return fail_plan(tick, tiller_status_plan_not_finite);
  const bool complete = completes(result);
  plan_.keep(tick.now_us, complete ? probe(tick, request, bounded_s) : planned_in_box(tick), tick.wanted);
  prediction_.predict(belief_.belief(), *planner_table_, planner_, request.task_step);
  // for the next plan, which may be prepared: what stands still has that time. A hand is not held against
  if (info_.touched == 0) steady_.update(*posterior_, info_.param_mean, info_.state_mean);

  if (result.iterations == 0) {
    // no time for a single iteration: the planner moved its last plan on by a step
    ++info_.late_plans;
    tick.note(tiller_status_deadline_missed);
    if (unrenewed_plans_ < kLongest) ++unrenewed_plans_;
    if (unrenewed_plans_ > plan_.horizon() / 2) return fail_plan(tick, tiller_status_deadline_missed);
    return;
  }
  unrenewed_plans_ = 0;
  ++info_.plans;
  // a replay stops by count where the recording stopped by its clock: the same thing, so the same status
  if (!complete) tick.note(forced_iterations_ != kNotForced ? tiller_status_iteration_capped : result.status);
  judge_plan(tick);
}

/// The sequence that goes out: the planner's, or one that finds out. Where the deadline cut the planner short there is
/// no time for it, and a replay, which knows the iterations, sees that too.
const float* Executive::probe(Tick& tick, const PlanRequest& request, double ahead_s) {
  if (probing_ == nullptr || info_.touched != 0) return planned_in_box(tick);
  const float* const sequence = planner_table_->sequence(planner_);
  return probing_->choose(*posterior_, timeline_, {stamp_us_, ahead_s, belief_.lead_periods()}, request, sequence,
                          tick.wanted, info_);
}

/// The planner's sequence; its command stays in the box of a calibration.
const float* Executive::planned_in_box(Tick& tick) {
  if (probing_) probing_->keep_in_box(tick.wanted);
  return planner_table_->sequence(planner_);
}

/// Whether the planner came to the end of what was asked of it.
bool Executive::completes(const PlanResult& result) const {
  if (probing_ && probing_->leads()) return result.status == tiller_status_ok || result.iterations > 0;
  const bool whole = result.iterations >= config_.planner.iterations || planner_table_->converges;
  return whole && result.status == tiller_status_ok;
}

/// A period is over. A calibration ends with motion, and the task begins behind it.
void Executive::pass_probing() {
  if (machine_.state() == tiller_state_safe || (was_moving_ && !moving())) probing_->end(info_);
  if (!moving() || !probing_->calibrating()) return;
  probing_->pass_period(info_);
  task_tick_ = info_.ticks + 1;
}

/// A good plan is followed unless something is in its way.
void Executive::judge_plan(Tick& tick) {
  if (info_.touched == 0) {
    (void)machine_.on(Event::plan_good);
    return;
  }
  tick.note(tiller_status_contact);
  (void)machine_.on(Event::plan_failed, tiller_status_contact);
}

void Executive::aim(PlanRequest& request) const {
  request.goal = goal_;
  request.origin = origin();
  request.steady_state = steady_.state();
  request.steady_input = steady_.input();
}

void Executive::continue_plan(Tick& tick) {
  if (machine_.state() != tiller_state_active) return;  // HOLD answers with its feedback
  const std::uint32_t step = plan_.step_at(tick.now_us);
  if (step >= plan_.horizon()) return fail_plan(tick, tick.status);
  std::copy(plan_.step(step), plan_.step(step) + config_.model->input_count, tick.wanted);
}

void Executive::fail_plan(Tick& tick, tiller_status_t why) {
  ++info_.plan_failures;
  tick.note(why);
  (void)machine_.on(Event::plan_failed, why);
}

Deadline Executive::deadline(const Tick& tick) {
  Deadline deadline;
  deadline.hooks = &hooks_;
  deadline.iterations = config_.planner.iterations;
  // a calibration needs of the planner no more than a way to hold the robot, until just before its end
  if (probing_ && probing_->leads()) deadline.iterations = std::min(deadline.iterations, std::uint32_t{1});
  if (forced_iterations_ != kNotForced) {
    // a replay: the clock of the recording has already decided
    deadline.iterations = forced_iterations_;
    deadline.replayed = true;
  } else if (has_clock() && config_.planner.deadline_us > 0) {
    const std::int64_t whole_ns = std::int64_t{config_.planner.deadline_us} * 1000;
    deadline.deadline_ns = tick.start_ns + whole_ns - reserve_ns_;
  }
  return deadline;
}

/// u = base - K (x - target), with differences of angles wrapped and those of quaternions turned. The base is the safe
/// command; of a robot that is touched, and knows what holds the target, that: an arm does not sink while it waits.
void Executive::hold_command(double* command) const {
  const tiller_model_t& model = *config_.model;
  double off[TILLER_MAX_STATES];
  state_differences(model, info_.state_mean, config_.cost.target, off);
  const double* const steady = info_.touched != 0 ? steady_.input() : nullptr;
  const double* const base = steady ? steady : config_.safety.safe_command;
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    command[i] = base[i];
    for (std::uint32_t x = 0; x < model.state_count; ++x) {
      const double gain = config_.safety.hold_gain[i * model.state_count + x];
      // a state without a gain has no say, not even by being infinite
      if (gain != 0.0) command[i] -= gain * off[x];
    }
  }
}

void Executive::count_hold(Tick& tick) {
  // held at its end: HOLD may last for ever, and a count that wraps would restart it
  const bool hold = machine_.state() == tiller_state_hold;
  hold_ticks_ = !hold ? 0 : hold_ticks_ + (hold_ticks_ < kLongest ? 1 : 0);
  const std::uint32_t most = config_.safety.hold_ticks_to_safe;
  if (most > 0 && hold_ticks_ >= most) (void)machine_.on(Event::hold_expired, tick.status);
}

// ---- gate ------------------------------------------------------------------------------------------------

void Executive::gate(Tick& tick, tiller_command_t& command) {
  double hold[TILLER_MAX_INPUTS] = {};
  command = tiller_command_t{};
  if (moving()) hold_command(hold);
  const tiller_status_t limited = gate_.answer(machine_, tick.wanted, hold, tick.elapsed_s, command.value);
  if (limited != tiller_status_ok) tick.note(limited);
  if (machine_.first_fault() != tiller_status_ok) {
    // HOLD and SAFE: what led there is why the command is what it is
    tick.status = machine_.first_fault();
  }
  command.stamp_us = tick.now_us;
  command.sequence = sequence_;
  command.state = machine_.state();
  command.plan_sequence = static_cast<std::uint32_t>(info_.plans);
  driven_ = moving();
  timeline_.push(effective_at_us(tick), command.value);
  info_.gate_clipped = gate_.cuts();
  info_.gate_rejections = gate_.rejections();
}

/// Never before now: a latency that has run out already, or that the caller does not know, ends with the
/// tick.
std::int64_t Executive::effective_at_us(const Tick& tick) const {
  std::int64_t at_us = 0;
  return __builtin_add_overflow(tick.now_us, actuation_latency_us_, &at_us) ? tick.now_us : at_us;
}

// ---- record ----------------------------------------------------------------------------------------------

void Executive::record(const Tick& tick, const tiller_command_t& command) {
  info_.state = machine_.state();
  info_.status = tick.status;
  info_.first_fault = machine_.first_fault();
  info_.planner_iterations = tick.iterations;
  info_.tick_ns = clock_ns() - tick.start_ns;

  tiller_record_t record{};
  record.tick = info_.ticks++;
  record.now_us = tick.now_us;
  if (tick.measurement) record.measurement = *tick.measurement;
  record.has_measurement = tick.measurement != nullptr;
  record.command = command;
  record.status = tick.status;
  record.planner_iterations = tick.iterations;
  record.plan_cost = info_.plan_cost;
  record.effective_samples = info_.effective_samples;
  record.noise_scale = info_.noise_scale;
  record.tick_ns = info_.tick_ns;
  std::copy(info_.state_mean, info_.state_mean + TILLER_MAX_STATES, record.state_mean);
  std::copy(info_.param_mean, info_.param_mean + TILLER_MAX_PARAMS, record.param_mean);
  std::copy(info_.param_sd, info_.param_sd + TILLER_MAX_PARAMS, record.param_sd);
  recorder_.push(record);
}

}  // namespace tiller
