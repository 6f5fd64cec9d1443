#include "bench/planning/uncertain_tasks.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "bench/planning/lockstep.hpp"
#include "bench/problems/planning_problem.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {
namespace {

constexpr double kUpright_rad = 0.3, kHeld_s = 1.0;
constexpr double kInf = INFINITY;

tiller::Config base(const char* model, const std::vector<double>& nominal) {
  tiller::Config c;
  tiller_config_default(&c, tiller_find_model(model));
  for (std::size_t i = 0; i < nominal.size(); ++i) c.priors[i] = {tiller_prior_fixed, 0, nominal[i], 0.0, -kInf, kInf};
  // as exact as the plant: at 20 ms the error of semi-implicit Euler costs more than parameters that are 30 % off, and
  // passes for process noise
  c.integrator = tiller_integrator_rk4;
  std::fill(c.measurement_sd, c.measurement_sd + TILLER_MAX_MEASUREMENTS, 0.002);
  std::fill(c.initial_state_sd, c.initial_state_sd + TILLER_MAX_STATES, 0.01);
  c.planner.kind = tiller_planner_mppi;
  c.planner.rollouts = 512;
  c.planner.iterations = 2;
  c.planner.temperature = 0.02;
  c.safety.sensor_timeout_s = 1.0;
  c.safety.frozen_ticks = 0;
  c.safety.bad_ticks_to_safe = 1000;
  c.safety.hold_ticks_to_safe = 0;
  return c;
}

void limit(tiller::Config& c, std::uint32_t input, double low, double high, double noise_sd) {
  c.safety.input_low[input] = low;
  c.safety.input_high[input] = high;
  c.planner.noise_sd[input] = noise_sd;
}

void weigh(tiller::Config& c, std::initializer_list<double> state, std::initializer_list<double> terminal,
           double input) {
  std::copy(state.begin(), state.end(), c.cost.state_weight);
  std::copy(terminal.begin(), terminal.end(), c.cost.terminal_weight);
  std::fill(c.cost.input_weight, c.cost.input_weight + TILLER_MAX_INPUTS, input);
}

tiller::Config informed(const UncertainTask& task, Knowledge knowledge, const std::vector<double>& truth) {
  tiller::Config c = task.config;
  set_knowledge(c, knowledge, task.hypotheses);
  for (const std::uint32_t i : task.off) {
    const double nominal = c.priors[i].a, off = task.off_share * nominal;
    if (knowledge == Knowledge::oracle) c.priors[i].a = truth[i];
    if (is_unsure(knowledge)) c.priors[i] = {tiller_prior_uniform, 0, 0.0, 0.0, nominal - off, nominal + off};
  }
  return c;
}

bool is_upright(const UncertainTask& task, const double* x) {
  const std::uint32_t i = static_cast<std::uint32_t>(task.upright_state);
  return std::abs(state_difference(*task.config.model, i, x[i], task.config.cost.target[i])) < kUpright_rad;
}

std::uint32_t whole(double v) { return static_cast<std::uint32_t>(std::max(v, 0.0)); }

}  // namespace

UncertainTask cart_pole_task() {
  UncertainTask t{"cart-pole", base("cart_pole", {1.0, 0.1, 0.5}), {0, 1, 2}, 400};
  tiller::Config& c = t.config;
  c.initial_state[1] = 3.141592653589793;
  c.measurement_sd[0] = 0.0005;
  c.planner.horizon = 40;
  c.planner.knots = 8;
  limit(c, 0, -20.0, 20.0, 8.0);
  weigh(c, {0.1, 1.0, 0.01, 0.01}, {100.0, 100.0, 10.0, 10.0}, 0.001);
  return t;
}

UncertainTask rail_task() {
  UncertainTask t = cart_pole_task();
  t.name = "cart-pole on a rail";
  constexpr double kMargin = 0.15;  // soft bounds give way, so the plan is given a shorter rail
  t.rail_m = 0.8;
  t.config.state_low[0] = -(t.rail_m - kMargin);
  t.config.state_high[0] = t.rail_m - kMargin;
  t.config.bound_weight[0] = 1e4;
  return t;
}

UncertainTask bounded_rail_task() {
  UncertainTask t = rail_task();
  t.name = "cart-pole on a rail, sqp";
  t.config.planner.kind = tiller_planner_sqp;
  t.config.cost.hard_bounds = 1u;
  t.config.bound_weight[0] = 0.0;  // a constraint in the place of the penalty, at the same shorter rail
  t.hypotheses = 8;
  return t;
}

UncertainTask acrobot_task() {
  // two uniform rods of 1 kg and 0.5 m; the masses and the lower rod's centre are what is not known
  UncertainTask t{"acrobot", base("acrobot", {1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 1.0 / 48.0, 1.0 / 48.0}), {0, 1, 5}, 400};
  tiller::Config& c = t.config;
  t.hypotheses = 8;
  c.cost.target[0] = 3.141592653589793;
  c.cost.terminal = tiller_terminal_lqr;
  c.measurement_sd[0] = c.measurement_sd[1] = 0.0005;
  c.process_sd[3] = 0.02;
  c.planner.horizon = 37;
  c.planner.knots = 12;
  c.planner.iterations = 6;
  c.planner.interpolation = tiller_interpolation_cubic;
  c.planner.adapt_covariance = 1;
  limit(c, 0, -6.0, 6.0, 5.0);
  weigh(c, {4.0, 1.0, 0.05, 0.02}, {}, 0.005);
  return t;
}

UncertainTask planar_quadrotor_task() {
  UncertainTask t{"planar quadrotor", base("planar_quadrotor", {0.5, 0.15, 0.005, 0.1}), {0, 1, 2}, 200};
  tiller::Config& c = t.config;
  c.initial_state[0] = -1.5;
  c.initial_state[1] = -0.5;
  c.planner.kind = tiller_planner_ilqr;
  c.planner.shooting = tiller_shooting_multiple;
  c.planner.iterations = 3;
  c.planner.horizon = 40;
  t.hypotheses = 8;
  limit(c, 0, 0.0, 6.0, 2.0);
  limit(c, 1, 0.0, 6.0, 2.0);
  weigh(c, {1.0, 1.0, 0.2, 0.05, 0.05, 0.01}, {50.0, 50.0, 10.0, 5.0, 5.0, 1.0}, 0.001);
  return t;
}

UncertainTask bounded_quadrotor_task() {
  UncertainTask t = planar_quadrotor_task();
  t.name = "planar quadrotor, sqp";
  t.config.planner.kind = tiller_planner_sqp;
  return t;
}

UncertainTask swing_up_task(std::uint32_t horizon, double off_share) {
  UncertainTask t = cart_pole_task();
  char name[80];
  std::snprintf(name, sizeof name, "swing-up, %.0f %% off, horizon %u", 100.0 * off_share, horizon);
  t.name = name;
  t.config.planner.horizon = horizon;
  t.config.planner.knots = 6;
  t.config.planner.rollouts = 256;
  t.hypotheses = 8;
  t.off_share = off_share;
  t.ticks = 300;
  t.upright_state = 1;
  return t;
}

bool override_setting(UncertainTask& task, const std::string& key, double value) {
  using Task = UncertainTask;
  static constexpr struct {
    const char* key;
    void (*set)(Task&, double);
  } settings[] = {
      {"planner", [](Task& t, double v) { t.config.planner.kind = whole(v); }},
      {"horizon", [](Task& t, double v) { t.config.planner.horizon = whole(v); }},
      {"knots", [](Task& t, double v) { t.config.planner.knots = whole(v); }},
      {"rollouts", [](Task& t, double v) { t.config.planner.rollouts = whole(v); }},
      {"iterations", [](Task& t, double v) { t.config.planner.iterations = whole(v); }},
      {"integrator", [](Task& t, double v) { t.config.integrator = whole(v); }},
      {"shooting", [](Task& t, double v) { t.config.planner.shooting = whole(v); }},
      {"refine", [](Task& t, double v) { t.config.planner.refine_iterations = whole(v); }},
      {"adapt", [](Task& t, double v) { t.config.planner.adapt_covariance = whole(v); }},
      {"interpolation", [](Task& t, double v) { t.config.planner.interpolation = whole(v); }},
      {"temperature", [](Task& t, double v) { t.config.planner.temperature = v; }},
      {"colour", [](Task& t, double v) { t.config.planner.noise_colour = v; }},
      {"anneal_iterations", [](Task& t, double v) { t.config.planner.anneal_iterations = v; }},
      {"anneal_horizon", [](Task& t, double v) { t.config.planner.anneal_horizon = v; }},
      {"sigma_points", [](Task& t, double v) { t.config.planner.hypotheses = whole(v); }},
      {"regularisation", [](Task& t, double v) { t.config.planner.regularisation = v; }},
      {"alpha", [](Task& t, double v) { t.config.planner.cvar_alpha = v; }},
      {"noise", [](Task& t, double v) { std::fill_n(t.config.planner.noise_sd, TILLER_MAX_INPUTS, v); }},
      {"shared_steps", [](Task& t, double v) { t.config.planner.shared_steps = whole(v); }},
      {"noise_ratio_sd", [](Task& t, double v) { t.config.posterior.noise_ratio_sd = v; }},
      {"hypotheses", [](Task& t, double v) { t.hypotheses = whole(v); }},
      {"particles", [](Task& t, double v) { t.config.posterior.particles = whole(v); }},
      {"moves", [](Task& t, double v) { t.config.posterior.moves_per_tick = whole(v); }},
      {"input_weight", [](Task& t, double v) { std::fill_n(t.config.cost.input_weight, TILLER_MAX_INPUTS, v); }},
      {"terminal",
       [](Task& t, double v) {
         for (double& w : t.config.cost.terminal_weight) w *= v;
       }},
      {"bound_weight", [](Task& t, double v) { t.config.bound_weight[0] = v; }},
      {"bound", [](Task& t, double v) { t.config.state_low[0] = -(t.config.state_high[0] = v); }},
      {"bound_risk", [](Task& t, double v) { t.config.cost.bound_risk = v; }},
      {"closed_loop", [](Task& t, double v) { t.config.planner.closed_loop = whole(v); }},
      {"noisy_rollouts", [](Task& t, double v) { t.config.planner.noisy_rollouts = whole(v); }},
      {"qp_iterations", [](Task& t, double v) { t.config.planner.qp_iterations = whole(v); }},
      {"hard_bounds", [](Task& t, double v) { t.config.cost.hard_bounds = whole(v); }},
      {"limit",
       [](Task& t, double v) {
         for (int i = 0; i < TILLER_MAX_INPUTS; ++i)
           t.config.safety.input_low[i] = -(t.config.safety.input_high[i] = v);
       }},
  };
  for (const auto& setting : settings)
    if (key == setting.key) {
      setting.set(task, value);
      return true;
    }
  return false;
}

UncertainRun run_uncertain(const UncertainTask& task, Knowledge knowledge, std::uint64_t seed,
                           const Observer& observe) {
  RandomStream random(seed);
  std::vector<double> truth;
  for (std::uint32_t i = 0; i < task.config.param_count; ++i) truth.push_back(task.config.priors[i].a);
  for (const std::uint32_t i : task.off) truth[i] *= 1.0 + task.off_share * (2.0 * random.uniform() - 1.0);

  tiller::Config config = informed(task, knowledge, truth);
  config.seed = seed;
  const LockstepController controller(task.name, config);
  tiller_t* t = controller.get();
  Plant plant(task.config, truth);
  UncertainRun run;
  std::uint32_t last_fall = 0;
  for (std::uint32_t k = 0; k < task.ticks; ++k) {
    const std::int64_t now_us = std::llround(k * config.period_s * 1e6);
    const tiller_measurement_t m = plant.measure(now_us, k, random);
    tiller_command_t command{};
    const auto begin = std::chrono::steady_clock::now();
    const int said = tiller_tick(t, now_us, &m, &command);
    run.tick_us +=
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count() / task.ticks;
    if (observe) observe(t, k, plant.x);
    run.bad_ticks += said >= 100 && said < 200;
    run.cost += step_cost(task.config, plant.x, command.value);
    plant.advance(command.value);
    if (task.noisy_plant) plant.disturb(random);
    run.farthest = std::max(run.farthest, std::abs(plant.x[0]));
    if (task.upright_state >= 0 && !is_upright(task, plant.x)) last_fall = k + 1;
  }
  run.held = task.upright_state >= 0 && (task.ticks - last_fall) * config.period_s >= kHeld_s;
  if (!std::isfinite(run.cost)) run.cost = 1e9;
  return run;
}

}  // namespace tiller::bench
