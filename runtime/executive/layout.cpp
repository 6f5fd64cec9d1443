#include <algorithm>
#include <cmath>

#include "core/element.hpp"
#include "executive/executive.hpp"

namespace tiller {
namespace {

GateLimits gate_limits(const tiller_config_t& config) {
  GateLimits limits;
  limits.count = config.model->input_count;
  limits.period_s = config.period_s;
  for (std::uint32_t i = 0; i < limits.count; ++i) {
    limits.low[i] = config.safety.input_low[i];
    limits.high[i] = config.safety.input_high[i];
    limits.rate_per_s[i] = config.safety.input_rate_per_s[i];
    limits.safe_command[i] = config.safety.safe_command[i];
  }
  limits.cones = make_input_cones(config.safety.cones, config.safety.cone_count);
  return limits;
}

SensorLimits sensor_limits(const tiller_config_t& config) {
  SensorLimits limits;
  limits.count = config.measurement_count;
  for (std::uint32_t i = 0; i < limits.count; ++i) {
    limits.low[i] = element_or(config.safety.measurement_low, i, -HUGE_VAL);
    limits.high[i] = element_or(config.safety.measurement_high, i, HUGE_VAL);
    limits.rate_per_s[i] = element_or(config.safety.measurement_rate_per_s, i, HUGE_VAL);
    if ((config.model->angle_mask >> config.measured_state[i]) & 1u) limits.angle_mask |= 1u << i;
    // the other three follow (tiller_config_check)
    if ((config.model->quaternion_mask >> config.measured_state[i]) & 1u) limits.quaternion_mask |= 1u << i;
  }
  limits.timeout_us = std::llround(config.safety.sensor_timeout_s * 1e6);
  limits.ahead_us = std::llround(config.period_s * 1e6);
  limits.frozen_ticks = config.safety.frozen_ticks;
  limits.bad_ticks_to_safe = config.safety.bad_ticks_to_safe;
  return limits;
}

/// Arrays of the caller's become ones of the block's. One without elements becomes null: a piece of no elements begins
/// where the next one does, and who asks "is there an array?" would read that.
template <class T>
T* keep(Arena& arena, const T*& array, std::size_t count) {
  if (count == 0) array = nullptr;
  T* own = count > 0 ? arena.take<T>(count) : nullptr;
  if (own == nullptr) return nullptr;
  std::copy(array, array + count, own);
  array = own;
  return own;
}

void keep_arrays(Arena& arena, tiller_config_t& c) {
  const std::size_t nx = c.model->state_count, nu = c.model->input_count, ny = c.measurement_count;
  (void)keep(arena, c.effects, c.effect_count);
  (void)keep(arena, c.priors, c.param_count);
  (void)keep(arena, c.cost.terms, c.cost.term_count);
  (void)keep(arena, c.safety.cones, c.safety.cone_count);
  if (!(c.probe.weight > 0.0)) c.probe.until_sd = nullptr;
  if (c.probe.until_sd != nullptr) (void)keep(arena, c.probe.until_sd, c.param_count);
  // the block is as large where one of these is left out: what that means is then written down
  const struct {
    const double*& array;
    std::size_t count;
    double none;
  } rows[] = {{c.cost.state_low, nx, -HUGE_VAL},
              {c.cost.state_high, nx, HUGE_VAL},
              {c.cost.bound_weight, nx, 0.0},
              {c.safety.hold_gain, nu * nx, 0.0},
              {c.safety.measurement_low, ny, -HUGE_VAL},
              {c.safety.measurement_high, ny, HUGE_VAL},
              {c.safety.measurement_rate_per_s, ny, HUGE_VAL}};
  std::size_t sum = 0;
  for (const auto& row : rows) sum += row.count;
  auto* own = arena.take<double>(sum);
  if (own == nullptr) return;
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.count; ++i) own[i] = element_or(row.array, i, row.none);
    row.array = own;
    own += row.count;
  }
}

/// How far back from the newest command anybody asks: the command takes hold so long after its measurement, the
/// transition before that began so long ago, and its commands acted after the longest delay of effects and hypotheses.
std::int64_t command_window_us(const tiller_config_t& config, const StepSetup& setup) {
  const double periods =
      kLongestLead_periods + kLongestGap_periods + 1.0 + setup.delay_steps + config.posterior.delay_hypotheses;
  return std::llround(periods * config.period_s * 1e6);
}

}  // namespace

Executive* Executive::lay_out(Arena& arena, const tiller_config_t& config, const tiller_hooks_t* hooks,
                              PartSizes* sizes) {
  const auto note = [&](const char* part) {
    if (sizes != nullptr) sizes->note(part, arena);
  };
  note("controller");
  Executive* placed = arena.take<Executive>(1);
  note("executive");
  // while measuring, a stand-in on the stack takes the pointers: both runs pass through the same lines below
  Executive stand_in;
  Executive& self = placed ? *placed : stand_in;
  self.config_ = config;
  self.moves_given_.reset(config.posterior.moves_per_tick);
  if (hooks) self.hooks_ = *hooks;
  self.outputs_ = keep(arena, self.config_.cost.outputs, config.cost.output_count);
  keep_arrays(arena, self.config_);
  if (make_step_setup(self.config_, self.setup_) != tiller_status_ok) return nullptr;
  self.table_ = &select_rollout(*config.model);
  self.planner_table_ = find_planner(config.planner.kind);
  if (self.planner_table_ == nullptr) return nullptr;

  self.guard_ = SensorGuard(sensor_limits(config));
  self.gate_ = OutputGate(gate_limits(config));
  self.posterior_ = Posterior::lay_out(arena, self.config_, self.setup_, *self.table_, &self.hooks_);
  note("posterior");
  const bool closed = self.planner_table_->feedback_if_closed && config.planner.closed_loop != 0;
  const bool over_delays = self.planner_table_->undelayed || closed || config.planner.predict_delay != 0 ||
                           config.posterior.delay_hypotheses > 1;
  self.belief_.lay_out(arena, self.config_, self.setup_, *self.table_, over_delays);
  note("planning belief");
  self.steady_.lay_out(arena, self.config_, self.belief_.planner_setup(), *self.table_);
  note("steady target");
  self.divergence_.lay_out(arena, self.config_);
  note("demonstration");
  self.planner_ =
      self.planner_table_->lay_out(arena, self.config_, self.belief_.planner_setup(), *self.table_, &self.hooks_);
  note("planner");
  self.plan_.lay_out(arena, self.config_);
  note("plan");
  self.prediction_.lay_out(arena, self.config_, self.belief_.planner_setup(), *self.table_);
  note("prediction");
  self.probing_ = Probing::lay_out(arena, self.config_, self.setup_, *self.table_);
  note("probing");
  self.timeline_.lay_out(arena, config.model->input_count, command_window_us(self.config_, self.setup_));
  note("command timeline");
  self.motion_.lay_out(arena, self.config_, self.belief_.forces(), *self.table_);
  note("motion check");
  self.recorder_.lay_out(arena, self.config_);
  note("recorder");
  self.history_ = arena.take<float>(std::size_t{self.setup_.delay_steps} * config.model->input_count);
  note("delay history");
  if (placed == nullptr) return nullptr;

  self.contact_.lay_out(self.config_);
  self.origin_.lay_out(periodic_angles(self.config_, self.setup_, *self.table_));
  self.posterior_->reset();
  self.planner_table_->reset(self.planner_);
  self.info_.effective_samples = self.posterior_->effective_samples();
  self.info_.noise_scale = self.posterior_->noise_scale();
  self.info_.force_joints = Posterior::force_joints(self.config_);
  self.info_.slip_states = Posterior::slip_states(self.config_);
  self.posterior_->moments(self.info_.param_mean, self.info_.param_sd, nullptr, nullptr);
  return placed;
}

}  // namespace tiller
