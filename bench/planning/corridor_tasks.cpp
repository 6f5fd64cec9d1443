#include "bench/planning/corridor_tasks.hpp"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <memory>

#include "bench/planning/corridor_models.hpp"
#include "bench/planning/lockstep.hpp"

namespace tiller::bench {
namespace {

constexpr double kInf = INFINITY;

tiller::Config base(const tiller_model_t* model, std::initializer_list<double> nominal) {
  tiller::Config c;
  tiller_config_default(&c, model);
  std::uint32_t i = 0;
  for (const double value : nominal) c.priors[i++] = {tiller_prior_fixed, 0, value, 0.0, -kInf, kInf};
  c.integrator = tiller_integrator_rk4;
  std::fill(c.measurement_sd, c.measurement_sd + TILLER_MAX_MEASUREMENTS, 0.002);
  std::fill(c.initial_state_sd, c.initial_state_sd + TILLER_MAX_STATES, 0.01);
  c.planner.kind = tiller_planner_mppi;
  c.planner.rollouts = 256;
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

void bound(tiller::Config& c, std::uint32_t state, double limit, double weight) {
  c.state_low[state] = -limit;
  c.state_high[state] = limit;
  c.bound_weight[state] = weight;
}

void weigh(tiller::Config& c, std::initializer_list<double> state, std::initializer_list<double> terminal,
           double input) {
  std::copy(state.begin(), state.end(), c.cost.state_weight);
  std::copy(terminal.begin(), terminal.end(), c.cost.terminal_weight);
  std::fill(c.cost.input_weight, c.cost.input_weight + TILLER_MAX_INPUTS, input);
}

double output_of(const tiller_model_t& model, const double* x, const double* params) {
  double y[TILLER_MAX_OUTPUTS];
  model.outputs(x, params, y);
  return y[0];
}

double nearest_post_m(double x_m, double z_m) {
  double nearest = kInf;
  for (int i = 0; i < GatePosts::kCount; ++i)
    nearest = std::min(nearest, std::hypot(x_m - GatePosts::x_m[i], z_m - GatePosts::z_m[i]));
  return nearest - GatePosts::kRadius_m;
}

/// Rows of a flight through the middle of both gates, for the nominal cable: x at constant speed, z along half cosines.
std::vector<double> gates_reference(double period_s, double goal_m, double half_cable_m) {
  constexpr double kSpeed_m_s = 1.0, kWait_s = 0.5;
  const double at_m[] = {-goal_m, -1.0, 1.0, goal_m};
  const double height_m[] = {0.0, 0.25 + half_cable_m, -0.65 + half_cable_m, 0.0};
  std::vector<double> rows;
  for (double time_s = -kWait_s; time_s * kSpeed_m_s <= 2.0 * goal_m; time_s += period_s) {
    const double x_m = -goal_m + kSpeed_m_s * std::max(time_s, 0.0);
    int part = 0;
    while (part < 2 && x_m > at_m[part + 1]) ++part;
    const double width_m = at_m[part + 1] - at_m[part], rise_m = height_m[part + 1] - height_m[part];
    const double phase = 3.141592653589793 * (x_m - at_m[part]) / width_m;
    const double speed_m_s = time_s > 0.0 ? kSpeed_m_s : 0.0;
    const double climb_m_s = speed_m_s * rise_m * 0.5 * 3.141592653589793 / width_m * std::sin(phase);
    const double z_m = height_m[part] + rise_m * 0.5 * (1.0 - std::cos(phase));
    for (const double value : {x_m, z_m, 0.0, 0.0, speed_m_s, climb_m_s, 0.0, 0.0}) rows.push_back(value);
  }
  for (const double value : {goal_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}) rows.push_back(value);
  return rows;
}

std::vector<double> draw_truth(const CorridorTask& task, RandomStream& random) {
  std::vector<double> truth;
  for (std::uint32_t i = 0; i < task.config.param_count; ++i) truth.push_back(task.config.priors[i].a);
  for (const Unknown& p : task.unknown) {
    if (p.truth_sd > 0.0)
      truth[p.index] += p.truth_sd * random.normal();
    else
      truth[p.index] = p.low + (p.high - p.low) * random.uniform();
  }
  return truth;
}

tiller::Config informed(const CorridorTask& task, Knowledge knowledge, const std::vector<double>& truth,
                        std::uint64_t seed) {
  tiller::Config c = task.config;
  c.seed = seed;
  set_knowledge(c, knowledge, task.hypotheses);
  for (const Unknown& p : task.unknown) {
    if (knowledge == Knowledge::oracle) c.priors[p.index].a = truth[p.index];
    if (is_unsure(knowledge)) c.priors[p.index] = {tiller_prior_uniform, 0, 0.0, 0.0, p.low, p.high};
  }
  c.cost.outputs = task.outputs.empty() ? nullptr : task.outputs.data();
  c.cost.output_count = static_cast<std::uint32_t>(task.outputs.size());
  c.cost.reference = task.reference.empty() ? nullptr : task.reference.data();
  c.cost.reference_steps = static_cast<std::uint32_t>(task.reference.size() / c.model->state_count);
  return c;
}

/// The oracle is told of a change: it goes on with the true parameters, from the true state.
std::unique_ptr<LockstepController> told(const CorridorTask& task, const std::vector<double>& truth, std::uint64_t seed,
                                         const double* state) {
  tiller::Config c = informed(task, Knowledge::oracle, truth, seed);
  std::copy(state, state + c.model->state_count, c.initial_state);
  return std::make_unique<LockstepController>(task.name, c);
}

/// A busy machine does not count in it.
double cpu_us() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

int count_covered(const CorridorTask& task, const tiller_t* t, const std::vector<double>& truth) {
  int covered = 0;
  for (const Unknown& p : task.unknown) {
    double low = 0.0, high = 0.0;
    tiller_get_quantile(t, p.index, 0.05, &low);
    tiller_get_quantile(t, p.index, 0.95, &high);
    covered += low <= truth[p.index] && truth[p.index] <= high;
  }
  return covered;
}

void print_tick(const tiller_t* t, std::uint32_t tick, const Plant& plant, const tiller_command_t& command,
                const CorridorTask& task, double clearance) {
  tiller_info_t info;
  tiller_get_info(t, &info);
  std::printf("%4u", tick);
  for (std::uint32_t i = 0; i < task.config.model->state_count; ++i) std::printf(" %7.3f", plant.x[i]);
  std::printf(" | u");
  for (std::uint32_t i = 0; i < task.config.model->input_count; ++i) std::printf(" %6.2f", command.value[i]);
  std::printf(" | gap %6.3f | p", clearance);
  for (const Unknown& p : task.unknown) std::printf(" %.3f+-%.3f", info.param_mean[p.index], info.param_sd[p.index]);
  std::printf(" | %s\n", tiller_status_name(static_cast<tiller_status_t>(info.status)));
}

/// The configuration with the target of that tick.
tiller_config_t due(const CorridorTask& task, std::uint32_t tick) {
  tiller_config_t c = task.config;
  if (task.reference.empty()) return c;
  const std::size_t nx = c.model->state_count, rows = task.reference.size() / nx;
  const double* row = task.reference.data() + nx * std::min<std::size_t>(tick, rows - 1);
  std::copy(row, row + nx, c.cost.target);
  return c;
}

std::uint32_t whole(double v) { return static_cast<std::uint32_t>(std::max(v, 0.0)); }

}  // namespace

CorridorTask grid_task() {
  CorridorTask t{};
  t.name = "point mass in a grid";
  // authors' program: 2 kg known to 0.1 kg, 1 kg more after 100 steps (15 ms), +-10 N, the map, the weights, and
  // a goal within 1 of the target over positions and velocities. Chosen here: a prior that is wide enough for the load
  // (the program's is normal around 2 kg), 600 steps in the place of 400, the horizon, the sensors
  t.config = base(&grid_point_mass_model(), {2.0, 0.0});
  t.unknown = {{0, 1.0, 4.0, 0.1, 1.0}};
  t.ticks = 600;
  t.change_tick = 100;
  tiller::Config& c = t.config;
  c.period_s = 0.015;
  c.measurement_count = 4;
  for (std::uint8_t i = 0; i < 4; ++i) {
    c.measured_state[i] = i;
    c.measurement_sd[i] = 0.01;
    c.initial_state[i] = i < 2 ? -9.0 : 0.0;
    c.cost.target[i] = i < 2 ? 9.0 : 0.0;
  }
  c.planner.horizon = 60;
  c.planner.knots = 10;
  for (std::uint32_t i = 0; i < 2; ++i) {
    limit(c, i, -10.0, 10.0, 6.0);
    bound(c, i, 10.7, 1e5);
    bound(c, i + 2, 4.0, 1e3);  // in the place of a clamp at 5 m/s: slow enough to stop within the horizon
  }
  weigh(c, {0.5, 0.5, 0.25, 0.25}, {1000.0, 1000.0, 0.1, 0.1}, 0.2);
  t.outputs = {{0.0, 0.0, 0.0, -kInf, -0.15, 1e6}};
  t.at_goal = [](const double* x) {
    return std::hypot(std::hypot(x[0] - 9.0, x[1] - 9.0), std::hypot(x[2], x[3])) <= 1.0;
  };
  t.clearance = [](const double* x, const double* params) {
    const double wall = 10.8 - std::max(std::abs(x[0]), std::abs(x[1]));
    return std::min(wall, -output_of(grid_point_mass_model(), x, params));
  };
  return t;
}

CorridorTask rail_end_task() {
  CorridorTask t{};
  t.name = "cart-pole to the rail's end";
  constexpr double kRail_m = 0.8, kLean_rad = 0.3, kGoal_m = 0.7;
  t.config = base(tiller_find_model("cart_pole"), {1.0, 0.3, 0.5});
  t.unknown = {{0, 0.5, 1.5}, {1, 0.15, 0.45}, {2, 0.25, 0.75}};
  t.ticks = 300;
  t.hold_ticks = 50;
  tiller::Config& c = t.config;
  c.initial_state[0] = -kGoal_m;
  c.cost.target[0] = kGoal_m;
  c.planner.horizon = 40;
  c.planner.knots = 8;
  limit(c, 0, -20.0, 20.0, 6.0);
  bound(c, 0, kRail_m - 0.05, 1e5);
  bound(c, 1, kLean_rad - 0.05, 1e5);
  weigh(c, {1.0, 1.0, 0.1, 0.1}, {100.0, 100.0, 20.0, 20.0}, 0.001);
  t.at_goal = [](const double* x) { return std::abs(x[0] - kGoal_m) < 0.05 && std::abs(x[1]) < 0.1; };
  t.clearance = [](const double* x, const double*) {
    return std::min(kRail_m - std::abs(x[0]), kLean_rad - std::abs(x[1]));
  };
  return t;
}

CorridorTask gates_task() {
  CorridorTask t{};
  t.name = "quadrotor with a slung load through gates";
  constexpr double kRadius_m = 0.2, kLoadRadius_m = 0.05, kMargin_m = 0.06, kGoal_m = 2.5, kCeiling_m = 1.5;
  t.config = base(&slung_quadrotor_model(), {0.5, 0.005, 0.2, 0.45});
  t.unknown = {{2, 0.05, 0.35}, {3, 0.3, 0.6}};
  t.ticks = 400;
  t.hold_ticks = 25;
  tiller::Config& c = t.config;
  c.initial_state[0] = -kGoal_m;
  c.cost.target[0] = kGoal_m;
  c.planner.horizon = 40;
  c.planner.knots = 8;
  c.posterior.particles = 96;
  c.planner.rollouts = 192;
  c.posterior.moves_per_tick = 8;
  limit(c, 0, 0.0, 6.0, 1.0);
  limit(c, 1, 0.0, 6.0, 1.0);
  bound(c, 1, kCeiling_m - kMargin_m, 1e5);
  weigh(c, {10.0, 10.0, 0.5, 0.5, 1.0, 1.0, 0.05, 0.1}, {100.0, 100.0, 5.0, 5.0, 10.0, 10.0, 0.5, 1.0}, 0.001);
  t.reference = gates_reference(c.period_s, kGoal_m, 0.5 * c.priors[3].a);
  c.cost.term_count = GatePosts::kCount;
  for (std::uint32_t i = 0; i < GatePosts::kCount; ++i)
    c.terms[i] = {tiller_cost_term_obstacles,
                  {0, 1},
                  0,
                  1e5,
                  {GatePosts::x_m[i], GatePosts::z_m[i], GatePosts::kRadius_m + kRadius_m + kMargin_m}};
  t.outputs = {{0.0, 0.0, 0.0, kLoadRadius_m + kMargin_m, kInf, 1e5}};
  t.at_goal = [](const double* x) { return std::hypot(x[0] - kGoal_m, x[1]) < 0.15 && std::hypot(x[4], x[5]) < 0.3; };
  t.clearance = [](const double* x, const double* params) {
    const double body = std::min(nearest_post_m(x[0], x[1]) - kRadius_m, kCeiling_m - std::abs(x[1]));
    return std::min(body, output_of(slung_quadrotor_model(), x, params) - kLoadRadius_m);
  };
  return t;
}

bool override_setting(CorridorTask& task, const std::string& key, double value) {
  using Task = CorridorTask;
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
      {"adapt", [](Task& t, double v) { t.config.planner.adapt_covariance = whole(v); }},
      {"interpolation", [](Task& t, double v) { t.config.planner.interpolation = whole(v); }},
      {"temperature", [](Task& t, double v) { t.config.planner.temperature = v; }},
      {"colour", [](Task& t, double v) { t.config.planner.noise_colour = v; }},
      {"shared_steps", [](Task& t, double v) { t.config.planner.shared_steps = whole(v); }},
      {"noisy_rollouts", [](Task& t, double v) { t.config.planner.noisy_rollouts = whole(v); }},
      {"noise", [](Task& t, double v) { std::fill_n(t.config.planner.noise_sd, TILLER_MAX_INPUTS, v); }},
      {"hypotheses", [](Task& t, double v) { t.hypotheses = whole(v); }},
      {"particles", [](Task& t, double v) { t.config.posterior.particles = whole(v); }},
      {"moves", [](Task& t, double v) { t.config.posterior.moves_per_tick = whole(v); }},
      {"window", [](Task& t, double v) { t.config.posterior.window = whole(v); }},
      {"posterior", [](Task& t, double v) { t.config.posterior.kind = whole(v); }},
      {"forgetting", [](Task& t, double v) { t.config.posterior.forgetting[0] = v; }},
      {"relearn", [](Task& t, double v) { t.config.posterior.relearn = whole(v); }},
      {"prior_proposal", [](Task& t, double v) { t.config.posterior.prior_proposal_fraction = v; }},
      {"noise_ratio_sd", [](Task& t, double v) { t.config.posterior.noise_ratio_sd = v; }},
      {"input_weight", [](Task& t, double v) { std::fill_n(t.config.cost.input_weight, TILLER_MAX_INPUTS, v); }},
      {"terminal",
       [](Task& t, double v) {
         for (double& w : t.config.cost.terminal_weight) w *= v;
       }},
      {"terminal_velocity",
       [](Task& t, double v) {
         const std::uint32_t half = t.config.model->state_count / 2;
         for (std::uint32_t i = half; i < 2 * half; ++i) t.config.cost.terminal_weight[i] = v;
       }},
      {"ticks", [](Task& t, double v) { t.ticks = whole(v); }},
      {"speed",
       [](Task& t, double v) {
         t.config.state_low[2] = t.config.state_low[3] = -(t.config.state_high[2] = t.config.state_high[3] = v);
       }},
      {"depth",
       [](Task& t, double v) {
         for (tiller_output_cost_t& o : t.outputs) std::isfinite(o.high) ? o.high = -v : o.low = v;
       }},
      {"penalty",
       [](Task& t, double v) {
         for (tiller_output_cost_t& o : t.outputs) o.bound_weight = v;
         for (tiller_cost_term_t& term : t.config.terms) term.weight = v;
         for (double& w : t.config.bound_weight) w = w > 0.0 ? v : 0.0;
       }},
  };
  for (const auto& setting : settings)
    if (key == setting.key) {
      setting.set(task, value);
      return true;
    }
  return false;
}

CorridorRun run_corridor(const CorridorTask& task, Knowledge knowledge, std::uint64_t seed, bool trace) {
  RandomStream random(seed);
  std::vector<double> truth = draw_truth(task, random);
  auto controller = std::make_unique<LockstepController>(task.name, informed(task, knowledge, truth, seed));
  Plant plant(task.config, truth);
  CorridorRun run;
  std::uint32_t held = 0;
  for (std::uint32_t k = 0; k < task.ticks && !run.reached; ++k) {
    if (k > 0 && k == task.change_tick) {
      for (const Unknown& p : task.unknown) truth[p.index] += p.load;
      plant.set_params(truth);
      if (knowledge == Knowledge::oracle) controller = told(task, truth, seed, plant.x);
    }
    const std::int64_t now_us = std::llround(k * task.config.period_s * 1e6);
    const tiller_measurement_t m = plant.measure(now_us, k, random);
    tiller_command_t command{};
    const double begin_us = cpu_us();
    tiller_tick(controller->get(), now_us, &m, &command);
    run.tick_us += cpu_us() - begin_us;
    run.cost += step_cost(due(task, k), plant.x, command.value);
    plant.advance(command.value);
    plant.disturb(random);
    const double clearance = task.clearance(plant.x, truth.data());
    run.least_gap = std::min(run.least_gap, clearance);
    run.violations += !(clearance >= 0.0);
    if (trace) print_tick(controller->get(), k, plant, command, task, clearance);
    held = task.at_goal(plant.x) ? held + 1 : 0;
    run.reached = held >= task.hold_ticks;
    run.ticks = k + 1;
  }
  run.tick_us /= run.ticks;
  if (!std::isfinite(run.cost)) run.cost = 1e9;
  run.covered = count_covered(task, controller->get(), truth);
  tiller_info_t info;
  tiller_get_info(controller->get(), &info);
  run.relearned = info.relearned;
  return run;
}

}  // namespace tiller::bench
