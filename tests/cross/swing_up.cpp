#include "swing_up.hpp"

#include <cmath>
#include <cstring>

#include "swing_up_policy.hpp"
#include "tiller/config.hpp"
#include "tiller/portable_math.hpp"

namespace swing_up {
namespace {

constexpr double kUpright_rad = 3.141592653589793;

tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0.0, 0.0, low, high}; }
tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, value, value}; }

char* put(char* at, const char* text) {
  while (*text != '\0') *at++ = *text++;
  return at;
}
char* put_number(char* at, std::uint64_t value) {
  char digits[20];
  int count = 0;
  do {
    digits[count++] = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value != 0);
  while (count > 0) *at++ = digits[--count];
  return at;
}
char* put_hex(char* at, std::uint64_t value) {
  for (int shift = 60; shift >= 0; shift -= 4) *at++ = "0123456789abcdef"[(value >> shift) & 15u];
  return at;
}

}  // namespace

void hash_bits(std::uint64_t& hash, double value) {
  std::uint64_t word;
  std::memcpy(&word, &value, sizeof word);
  for (int byte = 0; byte < 8; ++byte) hash = (hash ^ ((word >> (8 * byte)) & 0xffu)) * 1099511628211ull;
}

void Plant::step(double torque_Nm, double time_s) {
  constexpr double kStep_s = 1e-3;
  const double inertia = mass_kg * length_m * length_m;
  for (double t = 0.0; t < time_s - 0.5 * kStep_s; t += kStep_s) {
    const double gravity_Nm = mass_kg * 9.81 * length_m * tiller::portable::sin(angle_rad);
    const double free = rate_rad_s + kStep_s * (torque_Nm - damping_Nms * rate_rad_s - gravity_Nm) / inertia;
    const double most = kStep_s * friction_Nm / inertia;  // what dry friction can take of the rate in a step
    rate_rad_s = free > most ? free - most : free < -most ? free + most : 0.0;
    angle_rad += kStep_s * rate_rad_s;
  }
}

tiller::Config config(const Task& task) {
  const bool samples = task.kind == tiller_planner_mppi;
  tiller::Config c;
  if (tiller_config_default(&c, tiller_find_model("pendulum")) != tiller_status_ok) return tiller::Config{};
  if (task.friction_Nm > 0.0) {
    c.effect_count = 1;
    c.effects[0] = {tiller_effect_coulomb_friction, 0};
    c.priors[c.param_count++] = uniform(0.0, 0.05);
  }
  c.priors[0] = uniform(0.25, 0.75);
  c.priors[1] = fixed(0.5);
  c.priors[2] = uniform(0.0, 0.1);
  c.measurement_sd[0] = 0.002;
  c.process_sd[1] = 0.05;
  c.initial_state[0] = task.start_rad;
  c.initial_state_sd[0] = c.initial_state_sd[1] = 0.01;
  c.posterior.particles = 64;
  c.posterior.window = 16;
  c.posterior.moves_per_tick = 8;
  c.planner.kind = task.kind;
  c.planner.fallback = tiller_planner_policy;  // none
  c.policy = &kPolicy;
  c.planner.horizon = 40;
  c.planner.knots = 6;
  c.planner.rollouts = 32;
  c.planner.particles = samples ? 2 : 1;
  c.planner.iterations = 1;
  c.planner.noise_sd[0] = 1.0;
  c.cost.target[0] = kUpright_rad;
  c.cost.state_weight[0] = 4.0;
  c.cost.state_weight[1] = 0.05;
  c.cost.terminal_weight[0] = 50.0;
  c.cost.terminal_weight[1] = 2.0;
  c.cost.input_weight[0] = c.cost.input_rate_weight[0] = 0.01;
  c.safety.input_low[0] = -1.5;
  c.safety.input_high[0] = 1.5;
  c.hold_gain[1] = 0.2;
  c.safety.frozen_ticks = 0;  // dry friction holds the joint within a grain of its encoder for longer than any limit
  return c;
}

Result run(const Task& task, const tiller_config_t& config, void* memory, std::size_t size, std::uint32_t ticks,
           Watch watch, void* context, const tiller_hooks_t* hooks) {
  Result result;
  tiller_t* t = nullptr;
  result.status = tiller_init(&t, &config, hooks, memory, size);
  if (result.status != tiller_status_ok) return result;
  (void)tiller_arm(t);
  Plant plant;
  plant.angle_rad = task.start_rad;
  plant.friction_Nm = task.friction_Nm;
  const std::int64_t period_us = std::llround(config.period_s * 1e6);
  tiller_info_t info;
  for (std::uint32_t tick = 0; tick < ticks; ++tick) {
    const std::int64_t now_us = 1000000 + tick * period_us;
    tiller_measurement_t measurement = {};
    measurement.stamp_us = now_us;
    measurement.sequence = tick + 1;
    // an encoder of 4096 lines, read four times a line
    constexpr double kGrain_rad = 2.0 * kUpright_rad / 16384.0;
    measurement.value[0] = std::floor(plant.angle_rad / kGrain_rad + 0.5) * kGrain_rad;
    tiller_command_t command;
    (void)tiller_tick(t, now_us, &measurement, &command);
    plant.step(command.value[0], config.period_s);
    if (tick % kPush == kPush - 1) plant.rate_rad_s += (tick / kPush) % 2 == 0 ? task.push_rad_s : -task.push_rad_s;

    tiller_get_info(t, &info);
    result.plan_ns += info.plan_ns;
    if (info.plan_ns > result.longest_plan_ns) result.longest_plan_ns = info.plan_ns;
    hash_bits(result.hash, command.value[0]);
    for (std::uint32_t i = 0; i < 2; ++i) hash_bits(result.hash, info.state_mean[i]);
    for (std::uint32_t i = 0; i < config.param_count; ++i) hash_bits(result.hash, info.param_mean[i]);
    const double off_rad = std::remainder(plant.angle_rad - kUpright_rad, 2.0 * kUpright_rad);
    if (std::fabs(off_rad) < 0.3) ++result.upright_ticks;
    if (command.state == tiller_state_safe) ++result.safe_ticks;
    ++result.ticks;
    if (watch != nullptr) watch(context, tick);
  }
  result.mass_mean_kg = info.param_mean[0];
  result.mass_sd_kg = info.param_sd[0];
  return result;
}

bool good(const Result& result) {
  return result.status == tiller_status_ok && result.safe_ticks == 0 && 2 * result.upright_ticks > result.ticks;
}

void describe(const char* name, const Result& result, char* text) {
  char* at = put(text, name);
  if (result.status != tiller_status_ok) {
    at = put(put(at, " refused: "), tiller_status_name(result.status));
  } else {
    at = put_number(put(at, " ticks "), result.ticks);
    at = put_hex(put(at, " hash "), result.hash);
    at = put_number(put(at, " upright "), result.upright_ticks);
    at = put_number(put(at, " safe "), result.safe_ticks);
    at = put_number(put(at, " mass_mg "), static_cast<std::uint64_t>(result.mass_mean_kg * 1e6));
    at = put_number(put(at, " sd_mg "), static_cast<std::uint64_t>(result.mass_sd_kg * 1e6));
  }
  *at = '\0';
}

}  // namespace swing_up
