#include "rig.hpp"

#include <cmath>
#include <cstring>

#include "tiller/config.hpp"

namespace rig {
namespace {

constexpr double kStep_s = 1e-3;
constexpr double kGravity_m_s2 = 9.81;
constexpr std::size_t kCanary = 256;
constexpr unsigned char kCanaryByte = 0xa5;

/// RK4 of an n-vector in steps of at most kStep_s.
template <class F>
void integrate(double* x, int n, double time_s, const F& f) {
  const int steps = static_cast<int>(std::ceil(time_s / kStep_s - 1e-9));
  const double h = time_s / steps;
  double k[4][4], at[4];
  for (int s = 0; s < steps; ++s) {
    f(x, k[0]);
    for (int i = 0; i < n; ++i) at[i] = x[i] + 0.5 * h * k[0][i];
    f(at, k[1]);
    for (int i = 0; i < n; ++i) at[i] = x[i] + 0.5 * h * k[1][i];
    f(at, k[2]);
    for (int i = 0; i < n; ++i) at[i] = x[i] + h * k[2][i];
    f(at, k[3]);
    for (int i = 0; i < n; ++i) x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
  }
}

tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0.0, 0.0, low, high}; }
tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, value, value}; }

}  // namespace

void PendulumPlant::step(const double* command, double time_s) {
  double x[4] = {angle_rad, rate_rad_s, 0.0, 0.0};
  integrate(x, 2, time_s, [&](const double* s, double* dxdt) {
    dxdt[0] = s[1];
    dxdt[1] = command[0] / (mass_kg * length_m * length_m) - kGravity_m_s2 / length_m * std::sin(s[0]) -
              damping_Nms * s[1] / (mass_kg * length_m * length_m);
  });
  angle_rad = x[0];
  rate_rad_s = x[1];
}

void CartPolePlant::derivative(const double* s, double force_N, double* dxdt) const {
  // [M+m, m l cos; m l cos, 4/3 m l^2] [x''; a''] = [F + m l a'^2 sin; m g l sin], by Cramer's rule
  const double ml = pole_kg * half_length_m, sine = std::sin(s[1]), cosine = std::cos(s[1]);
  const double m00 = cart_kg + pole_kg, m01 = ml * cosine, m11 = 4.0 / 3.0 * ml * half_length_m;
  const double r0 = force_N + ml * s[3] * s[3] * sine, r1 = ml * kGravity_m_s2 * sine;
  const double determinant = m00 * m11 - m01 * m01;
  dxdt[0] = s[2];
  dxdt[1] = s[3];
  dxdt[2] = (r0 * m11 - m01 * r1) / determinant;
  dxdt[3] = (m00 * r1 - m01 * r0) / determinant;
}

void CartPolePlant::step(const double* command, double time_s) {
  integrate(x, 4, time_s, [&](const double* s, double* dxdt) { derivative(s, command[0], dxdt); });
}

namespace {

// u = 12 sin(angle) - 2 rate, over the 3 N m of the limits: holds the pendulum of the rig upright
constexpr float kHold[] = {0.0f, 4.0f, 0.0f, -2.0f / 3.0f};
constexpr float kLow[] = {-0.2f, -1.0f, -1.0f}, kHigh[] = {0.2f, -0.98f, 1.0f};
constexpr tiller_network_t kNetwork = {
    sizeof(tiller_network_t), TILLER_CONFIG_VERSION, tiller_network_tanh, 3, 1, 1, {0, 0}, kHold, 4, 0};
constexpr tiller_policy_t kPolicy = {
    sizeof(tiller_policy_t), TILLER_CONFIG_VERSION, tiller_policy_state, tiller_policy_cut, &kNetwork, kLow, kHigh};

}  // namespace

tiller::Config pendulum_config() {
  tiller::Config c;
  if (tiller_config_default(&c, tiller_find_model("pendulum")) != tiller_status_ok) return tiller::Config{};
  c.priors[0] = uniform(0.8, 1.6);
  c.priors[1] = fixed(0.5);
  c.priors[2] = uniform(0.0, 0.2);
  c.record_ticks = 64;
  c.posterior.particles = 64;
  c.posterior.window = 16;
  c.posterior.moves_per_tick = 8;
  c.planner.horizon = 40;
  c.planner.knots = 8;
  c.planner.rollouts = 128;
  c.planner.particles = 4;
  c.planner.noise_sd[0] = 2.0;
  c.planner.fallback = tiller_planner_mppi;
  c.policy = &kPolicy;
  c.cost.target[0] = 3.141592653589793;
  c.cost.state_weight[0] = c.cost.terminal_weight[0] = 10.0;
  c.cost.state_weight[1] = c.cost.terminal_weight[1] = 0.5;
  c.cost.input_rate_weight[0] = 0.01;
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  c.safety.input_rate_per_s[0] = 100.0;
  c.measurement_low[0] = -50.0;
  c.measurement_high[0] = 50.0;
  c.measurement_rate_per_s[0] = 40.0;
  c.hold_gain[1] = 0.3;  // damps the joint
  c.safety.bad_ticks_to_safe = 3;
  c.safety.frozen_ticks = 10;
  return c;
}

tiller::Config cart_pole_config() {
  tiller::Config c;
  if (tiller_config_default(&c, tiller_find_model("cart_pole")) != tiller_status_ok) return tiller::Config{};
  c.priors[0] = fixed(1.0);
  c.priors[1] = uniform(0.05, 0.15);
  c.priors[2] = uniform(0.25, 0.75);
  c.initial_state[1] = 3.141592653589793;
  c.record_ticks = 64;
  c.planner.noise_sd[0] = 8.0;
  const double state[] = {1.0, 4.0, 0.1, 0.1}, terminal[] = {10.0, 100.0, 1.0, 10.0};
  std::memcpy(c.cost.state_weight, state, sizeof state);
  std::memcpy(c.cost.terminal_weight, terminal, sizeof terminal);
  c.cost.input_weight[0] = c.cost.input_rate_weight[0] = 1e-3;
  c.safety.input_low[0] = -20.0;
  c.safety.input_high[0] = 20.0;
  c.safety.input_rate_per_s[0] = 1000.0;
  c.hold_gain[2] = 4.0;
  return c;
}

Block::Block(std::size_t size)
    : storage_(new unsigned char[size + TILLER_ALIGNMENT + 2 * kCanary]), memory_(nullptr), size_(size) {
  const std::uintptr_t first = reinterpret_cast<std::uintptr_t>(storage_.get()) + kCanary;
  const std::uintptr_t aligned = (first + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT;
  memory_ = storage_.get() + (aligned - reinterpret_cast<std::uintptr_t>(storage_.get()));
  std::memset(memory_ - kCanary, kCanaryByte, size + 2 * kCanary);
}

bool Block::canaries_alive() const {
  for (std::size_t i = 1; i <= kCanary; ++i)
    if (*(memory_ - i) != kCanaryByte || memory_[size_ + i - 1] != kCanaryByte) return false;
  return true;
}

Loop::Loop(const tiller_config_t& config, Plant& plant, const tiller_hooks_t* hooks)
    : config_(config),
      plant_(plant),
      block_(tiller_size(&config)),
      status_(tiller_init(&t_, &config, hooks, block_.memory(), block_.size())),
      period_us_(std::llround(config.period_s * 1e6)) {}

tiller_measurement_t Loop::measure() {
  tiller_measurement_t m = {};
  m.stamp_us = now_us_;
  m.sequence = ++sequence_;
  plant_.measure(m.value);
  return m;
}

tiller_status_t Loop::tick(const tiller_measurement_t* m) {
  const tiller_command_t before = command_;
  const tiller_status_t status = tiller_tick(t_, now_us_, m, &command_);
  judge(before);
  wait(period_us_);
  return status;
}

void Loop::wait(std::int64_t time_us) {
  plant_.step(command_.value, static_cast<double>(time_us) * 1e-6);
  now_us_ += time_us;
}

void Loop::activate(int ticks) {
  (void)tiller_arm(t_);
  run(ticks);
}

tiller_info_t Loop::info() const {
  tiller_info_t info;
  tiller_get_info(t_, &info);
  return info;
}

void Loop::judge(const tiller_command_t& before) {
  const bool moving = command_.state == tiller_state_active || command_.state == tiller_state_hold;
  for (std::uint32_t i = 0; i < config_.model->input_count; ++i) {
    const double u = command_.value[i];
    if (!(u >= config_.safety.input_low[i] && u <= config_.safety.input_high[i])) allowed_ = false;
    // one microsecond of grain (the gate's) above rate * period
    const double step = config_.safety.input_rate_per_s[i] * (config_.period_s + 1e-6);
    if (moving && std::abs(u - before.value[i]) > step) allowed_ = false;
    if (!moving && u != config_.safety.safe_command[i]) allowed_ = false;
  }
}

}  // namespace rig
