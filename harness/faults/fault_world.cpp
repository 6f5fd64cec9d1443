#include "harness/faults/fault_world.hpp"

#include <cmath>

#include "tiller/config.hpp"

namespace tiller::faults {
namespace {

constexpr double kPi = 3.14159265358979323846;

tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0.0, 0.0, low, high}; }
tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, value, value}; }

/// Small sizes: what is shown here is what happens, not how well it steers.
void size_down(tiller::Config& c) {
  c.posterior.particles = 64;
  c.posterior.window = 16;
  c.posterior.moves_per_tick = 8;
  c.planner.horizon = 30;
  c.planner.knots = 6;
  c.planner.rollouts = 64;
  c.planner.particles = 4;
  c.planner.iterations = 2;
  c.safety.sensor_timeout_s = 0.1;
  c.safety.bad_ticks_to_safe = 3;
  c.safety.frozen_ticks = 10;
  c.safety.hold_ticks_to_safe = 25;
  c.record_ticks = 16;
}

tiller::Config pendulum(Random& random, sim::PlantOptions& plant) {
  tiller::Config c{};
  (void)tiller_config_default(&c, tiller_find_model("pendulum"));
  size_down(c);
  c.priors[0] = uniform(0.25, 0.75);
  c.priors[1] = fixed(0.5);
  c.priors[2] = uniform(0.0, 0.1);
  c.measurement_sd[0] = 0.002;
  c.planner.noise_sd[0] = 1.0;
  c.cost.target[0] = kPi;
  c.cost.state_weight[0] = 4.0;
  c.cost.state_weight[1] = 0.05;
  c.cost.terminal_weight[0] = 50.0;
  c.cost.terminal_weight[1] = 2.0;
  c.cost.input_weight[0] = c.cost.input_rate_weight[0] = 0.01;
  c.safety.input_low[0] = -1.5;
  c.safety.input_high[0] = 1.5;
  c.safety.input_rate_per_s[0] = 60.0;
  c.measurement_low[0] = -60.0;
  c.measurement_high[0] = 60.0;
  c.measurement_rate_per_s[0] = 18.0;
  c.hold_gain[1] = 0.2;
  plant.kind = "pendulum";
  plant.parameters["mass_kg"] = random.uniform(0.3, 0.7);
  plant.parameters["damping_Nms"] = random.uniform(0.01, 0.09);
  plant.initial_state["angle_rad"] = random.uniform(-0.1, 0.1);
  plant.encoder_noise_sd["angle_rad"] = 0.002;
  return c;
}

tiller::Config cart_pole(Random& random, sim::PlantOptions& plant) {
  tiller::Config c{};
  (void)tiller_config_default(&c, tiller_find_model("cart_pole"));
  size_down(c);
  c.priors[0] = fixed(1.0);
  c.priors[1] = uniform(0.05, 0.15);
  c.priors[2] = uniform(0.35, 0.65);
  c.initial_state[1] = kPi;
  c.measurement_sd[0] = 0.0005;
  c.measurement_sd[1] = 0.002;
  c.planner.noise_sd[0] = 8.0;
  const double state[] = {1.0, 4.0, 0.1, 0.1}, terminal[] = {10.0, 100.0, 1.0, 10.0};
  std::copy(state, state + 4, c.cost.state_weight);
  std::copy(terminal, terminal + 4, c.cost.terminal_weight);
  c.cost.input_weight[0] = c.cost.input_rate_weight[0] = 1e-3;
  c.safety.input_low[0] = -20.0;
  c.safety.input_high[0] = 20.0;
  c.safety.input_rate_per_s[0] = 1000.0;
  c.measurement_low[0] = -8.0;
  c.measurement_high[0] = 8.0;
  c.measurement_low[1] = -60.0;
  c.measurement_high[1] = 60.0;
  c.measurement_rate_per_s[0] = 12.0;
  c.measurement_rate_per_s[1] = 18.0;
  c.hold_gain[2] = 4.0;
  plant.kind = "cart_pole";
  plant.parameters["pole_mass_kg"] = random.uniform(0.06, 0.14);
  plant.parameters["half_length_m"] = random.uniform(0.4, 0.6);
  plant.initial_state["angle_rad"] = kPi + random.uniform(-0.1, 0.1);
  plant.encoder_noise_sd["position_m"] = 0.0005;
  plant.encoder_noise_sd["angle_rad"] = 0.002;
  return c;
}

}  // namespace

const char* name_of(Robot robot) { return robot == Robot::kPendulum ? "pendulum" : "cart-pole"; }

const char* name_of(Route route) {
  switch (route) {
    case Route::kMemory: return "memory";
    case Route::kBus: return "CAN";
    case Route::kSocket: return "virtual CAN";
    case Route::kLcm: break;
  }
  return "LCM";
}

std::uint64_t Random::next() {
  state_ += 0x9e3779b97f4a7c15u;
  std::uint64_t z = state_;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

double Random::uniform(double low, double high) {
  return low + (high - low) * static_cast<double>(next() >> 11) * 0x1p-53;
}

Setup setup_of(Robot robot, std::uint64_t seed) {
  Random random(seed * 2 + static_cast<std::uint64_t>(robot));
  Setup s{};
  s.robot = robot;
  s.config = robot == Robot::kPendulum ? pendulum(random, s.plant) : cart_pole(random, s.plant);
  s.config.seed = s.plant.seed = seed;
  s.plant.watchdog_timeout_s = 0.1;
  s.plan_timeout_s = 0.5;
  s.heartbeat_timeout_us = 200000;
  return s;
}

}  // namespace tiller::faults
