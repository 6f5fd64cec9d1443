#include "bench/planning/dual_tasks.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "bench/planning/dual_models.hpp"

namespace tiller::bench {
namespace {

constexpr double kInf = INFINITY;

std::uint32_t whole(double v) { return static_cast<std::uint32_t>(std::max(v, 0.0)); }

tiller::Config base(const tiller_model_t& model, double low, double high) {
  tiller::Config c;
  tiller_config_default(&c, &model);
  c.priors[0] = {tiller_prior_uniform, 0, 0.0, 0.0, low, high};
  std::fill(c.initial_state_sd, c.initial_state_sd + TILLER_MAX_STATES, 0.01);
  c.planner.kind = tiller_planner_cem;
  c.planner.rollouts = 512;
  c.planner.particles = 8;
  c.planner.iterations = 2;
  c.posterior.noise_ratio_sd = 0.0;
  c.posterior.adequacy = 0;
  c.posterior.relearn = 0;
  c.safety.sensor_timeout_s = 1.0;
  c.safety.frozen_ticks = 0;
  c.safety.bad_ticks_to_safe = 1000;
  c.safety.hold_ticks_to_safe = 0;
  c.probe.budget = 0.2;
  return c;
}

void weigh(tiller::Config& c, std::initializer_list<double> state, double input) {
  std::copy(state.begin(), state.end(), c.cost.state_weight);
  std::fill(c.cost.input_weight, c.cost.input_weight + TILLER_MAX_INPUTS, input);
}

void limit(tiller::Config& c, std::uint32_t input, double low, double high) {
  c.safety.input_low[input] = low;
  c.safety.input_high[input] = high;
}

/// Rows of the same target.
std::vector<double> hold(std::uint32_t ticks, std::initializer_list<double> target) {
  std::vector<double> rows;
  for (std::uint32_t k = 0; k < ticks; ++k) rows.insert(rows.end(), target);
  return rows;
}

/// The task's cost: target of the row, weights, soft bounds beyond their slack, the outputs' bounds.
double task_cost(const DualTask& task, const std::vector<double>& truth, std::uint32_t tick, const double* x,
                 const double* u) {
  const tiller_config_t& c = task.config;
  const tiller_model_t& model = *c.model;
  double sum = 0.0, far = 0.0;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const double d = state_difference(model, i, x[i], task.reference[std::size_t{tick} * model.state_count + i]);
    const double out =
        std::max({0.0, task.config.state_low[i] - task.slack - x[i], x[i] - task.config.state_high[i] - task.slack});
    sum += c.cost.state_weight[i] * d * d + task.config.bound_weight[i] * (out > 0.0 ? out * out : 0.0);
  }
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const double d = (x[i] - task.reference[std::size_t{tick} * model.state_count + i]) / c.cost.saturating_width[i];
    far += d * d;
  }
  sum += c.cost.saturating_weight * (1.0 - std::exp(-0.5 * far));
  for (std::uint32_t i = 0; i < model.input_count; ++i) sum += c.cost.input_weight[i] * u[i] * u[i];
  if (c.cost.output_count == 0) return sum;
  double y[TILLER_MAX_STATES] = {};
  model.outputs(x, truth.data(), y);
  for (std::uint32_t j = 0; j < c.cost.output_count; ++j) {
    const tiller_output_cost_t& o = c.cost.outputs[j];
    const double out = std::max({0.0, o.low - y[j], y[j] - o.high});
    sum += o.bound_weight * out * out;
  }
  return sum;
}

tiller::Config informed(const DualTask& task, Manner manner, double truth) {
  tiller::Config c = task.config;
  if (task.delay_ticks > 0) {
    c.effect_count = 1;
    c.effects[0] = {tiller_effect_input_delay, 0};
    c.priors[c.param_count++] = {tiller_prior_fixed, 0, task.delay_ticks * c.period_s, 0.0, -kInf, kInf};
  }
  switch (manner) {
    case Manner::certain: c.planner.particles = 1; break;
    case Manner::tree:
      c.planner.closed_loop = 1;
      c.planner.shared_steps = (c.planner.horizon + 2) / 3;
      break;
    case Manner::probing: c.probe.weight = 1.0; break;
    case Manner::oracle:
      c.planner.particles = 1;
      c.posterior.enabled = 0;
      c.priors[task.unknown] = {tiller_prior_fixed, 0, truth, 0.0, -kInf, kInf};
      break;
    default: break;
  }
  return c;
}

}  // namespace

const char* manner_name(Manner manner) {
  switch (manner) {
    case Manner::passive: return "passive";
    case Manner::certain: return "certainty equivalence";
    case Manner::tree: return "closed-loop plans";
    case Manner::noise: return "white noise";
    case Manner::probing: return "probing";
    default: return "oracle";
  }
}

DualTask set_down_task() {
  DualTask t;
  t.name = "set down";
  t.low = 1.0;
  t.high = 8.0;
  t.config = base(*tiller_find_model("linear_axis"), t.low, t.high);
  tiller::Config& c = t.config;
  c.measurement_sd[0] = 0.025;
  c.process_sd[1] = 0.02;
  c.planner.horizon = 40;
  c.planner.knots = 10;
  limit(c, 0, -20.0, 20.0);
  weigh(c, {100.0, 0.0}, 1e-4);
  c.initial_state[1] = 0.05;
  t.ticks = 160;
  constexpr std::uint32_t kCarried = 100;
  for (std::uint32_t k = 0; k < t.ticks; ++k) {
    const bool carried = k < kCarried;
    t.reference.push_back(carried ? 0.05 * 0.02 * k : 0.3);
    t.reference.push_back(carried ? 0.05 : 0.0);
  }
  t.delay_ticks = 5;
  c.state_high[0] = 0.31;
  c.bound_weight[0] = 1e5;
  t.slack = 0.02;
  t.jitter = {0.01, 0.0};
  t.jitter_ticks = kCarried;
  t.fails = [](const double* x) { return x[0] > 0.35; };
  return t;
}

DualTask braking_task() {
  constexpr double kSpeed_m_s = 10.0, kStop_m = 30.0, kEdge_m = 31.0;
  DualTask t;
  t.name = "brake before an edge";
  t.low = 0.25;
  t.high = 0.9;
  t.config = base(braking_car_model(), t.low, t.high);
  tiller::Config& c = t.config;
  c.period_s = 0.1;
  c.measurement_count = 2;
  c.measured_state[0] = 0;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = 0.05;
  c.measurement_sd[1] = 0.1;
  c.process_sd[1] = 0.1;
  c.planner.horizon = 50;
  c.planner.knots = 10;
  c.planner.rollouts = 2048;
  c.planner.particles = 16;  // of 8 draws the least grip is often far above the least possible
  limit(c, 0, -9.0, 9.0);
  weigh(c, {1.0, 0.0}, 1e-3);
  c.initial_state[1] = kSpeed_m_s;
  t.ticks = 100;
  for (std::uint32_t k = 0; k < t.ticks; ++k) {
    t.reference.push_back(std::fmin(kSpeed_m_s * k * c.period_s, kStop_m));
    t.reference.push_back(0.0);
  }
  c.state_high[0] = kEdge_m;
  c.bound_weight[0] = 1e3;
  t.slack = 0.5;
  t.jitter = {1.0, 0.0};
  t.jitter_ticks = 20;
  t.fails = [](const double* x) { return x[0] > kEdge_m + 1.0; };
  return t;
}

DualTask balancing_task() {
  DualTask t;
  t.name = "balance, sign unknown";
  t.low = -1.0;
  t.high = 1.0;
  t.config = base(signed_balancer_model(), t.low, t.high);
  tiller::Config& c = t.config;
  c.measurement_sd[0] = 0.005;
  c.process_sd[1] = 0.1;
  c.planner.horizon = 40;
  c.planner.knots = 10;
  limit(c, 0, -4.0, 4.0);
  weigh(c, {10.0, 0.1}, 1e-3);
  t.ticks = 200;
  t.reference = hold(t.ticks, {0.0, 0.0});
  c.state_low[0] = -0.3;
  c.state_high[0] = 0.3;
  c.bound_weight[0] = 1e3;
  t.slack = 0.05;
  t.jitter = {0.05, 0.0};
  t.jitter_ticks = 200;
  t.fails = [](const double* x) { return std::fabs(x[0]) > 0.6; };
  return t;
}

DualTask slot_task() {
  static const tiller_output_cost_t kSlot[] = {{0.0, 0.0, 0.0, -0.02, 0.02, 1e5}};
  DualTask t;
  t.name = "reach through a slot";
  t.low = 0.0;
  t.high = 3.0;
  t.config = base(sagging_arm_model(), t.low, t.high);
  tiller::Config& c = t.config;
  c.measurement_count = 2;
  c.measured_state[0] = 0;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = c.measurement_sd[1] = 0.003;
  c.process_sd[2] = c.process_sd[3] = 0.05;
  c.planner.horizon = 60;
  c.planner.knots = 10;
  limit(c, 0, -6.0, 6.0);
  limit(c, 1, -1.0, 1.0);
  weigh(c, {1.0, 0.1, 0.01, 0.01}, 1e-3);
  c.initial_state[0] = 0.2;
  c.cost.outputs = kSlot;
  c.cost.output_count = 1;
  t.ticks = 250;
  for (std::uint32_t k = 0; k < t.ticks; ++k)
    for (const double v : {k < 100 ? 0.2 : 1.2, 0.0, 0.0, 0.0}) t.reference.push_back(v);
  t.jitter = {0.1, 0.1, 0.0, 0.0};
  t.jitter_ticks = 60;
  return t;
}

DualTask climb_task() {
  DualTask t;
  t.name = "climb, a rotor weak";
  t.low = 2.7;
  t.high = 6.0;
  t.config = base(weak_quadrotor_model(), t.low, t.high);
  tiller::Config& c = t.config;
  c.measurement_count = 3;
  for (std::uint8_t i = 0; i < 3; ++i) {
    c.measured_state[i] = i;
    c.measurement_sd[i] = 0.005;
    c.process_sd[3 + i] = 0.1;
  }
  c.planner.horizon = 50;
  c.planner.knots = 10;
  limit(c, 0, 0.0, 6.0);
  limit(c, 1, 0.0, 6.0);
  weigh(c, {1.0, 4.0, 1.0, 0.1, 0.1, 0.05}, 1e-3);
  t.ticks = 200;
  for (std::uint32_t k = 0; k < t.ticks; ++k)
    for (const double v : {0.0, k < 75 ? 0.0 : 2.0, 0.0, 0.0, 0.0, 0.0}) t.reference.push_back(v);
  c.state_low[2] = -0.5;
  c.state_high[2] = 0.5;
  c.bound_weight[2] = 1e3;
  t.slack = 0.1;
  t.jitter = {0.0, 0.1, 0.0, 0.0, 0.0, 0.0};
  t.jitter_ticks = 75;
  t.fails = [](const double* x) { return std::fabs(x[2]) > 1.2 || x[1] < -1.0; };
  return t;
}

std::vector<DualTask> dual_tasks() {
  return {set_down_task(), braking_task(), balancing_task(), slot_task(), climb_task()};
}

bool override_setting(DualTask& task, const std::string& key, double value) {
  static constexpr struct {
    const char* key;
    void (*set)(DualTask& t, double v);
  } settings[] = {
      {"budget", [](DualTask& t, double v) { t.config.probe.budget = v; }},
      {"probe_rollouts", [](DualTask& t, double v) { t.config.probe.rollouts = whole(v); }},
      {"probe_hypotheses", [](DualTask& t, double v) { t.config.probe.hypotheses = whole(v); }},
      {"planner", [](DualTask& t, double v) { t.config.planner.kind = whole(v); }},
      {"horizon", [](DualTask& t, double v) { t.config.planner.horizon = whole(v); }},
      {"rollouts", [](DualTask& t, double v) { t.config.planner.rollouts = whole(v); }},
      {"particles", [](DualTask& t, double v) { t.config.planner.particles = whole(v); }},
      {"sensor",
       [](DualTask& t, double v) {
         for (double& sd : t.config.measurement_sd) sd *= v;
       }},
      {"process",
       [](DualTask& t, double v) {
         for (double& sd : t.config.process_sd) sd *= v;
       }},
      {"jitter",
       [](DualTask& t, double v) {
         for (double& sd : t.jitter) sd *= v;
       }},
  };
  for (const auto& setting : settings)
    if (key == setting.key) {
      setting.set(task, value);
      return true;
    }
  return false;
}

DualRun run_dual(const DualTask& task, Manner manner, std::uint64_t seed) {
  RandomStream random(seed);
  const std::uint32_t nx = task.config.model->state_count;
  std::vector<double> truth;
  for (std::uint32_t i = 0; i < task.config.param_count; ++i) truth.push_back(task.config.priors[i].a);
  truth[task.unknown] = task.low + (task.high - task.low) * random.uniform();
  tiller::Config config = informed(task, manner, truth[task.unknown]);
  config.seed = seed;
  std::vector<double> reference = task.reference;
  RandomStream jitter(seed + 77);
  for (std::size_t k = 0; manner == Manner::noise && k < task.jitter_ticks; ++k)
    for (std::uint32_t i = 0; i < nx; ++i) reference[k * nx + i] += task.jitter[i] * jitter.normal();
  config.cost.reference = reference.data();
  config.cost.reference_steps = task.ticks;
  const LockstepController controller(task.name, config);
  tiller_t* t = controller.get();
  Plant plant(task.config, truth);
  DualRun run;
  tiller_info_t info;
  std::vector<tiller_command_t> sent;
  const tiller_command_t idle{};
  for (std::uint32_t k = 0; k < task.ticks; ++k) {
    const std::int64_t now_us = std::llround(k * config.period_s * 1e6);
    const tiller_measurement_t m = plant.measure(now_us, k, random);
    tiller_command_t command{};
    const auto begin = std::chrono::steady_clock::now();
    (void)tiller_tick(t, now_us, &m, &command);
    run.tick_us +=
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count() / task.ticks;
    if (k == task.ticks / 3) {
      tiller_get_info(t, &info);
      run.sd = info.param_sd[task.unknown];
    }
    run.cost += task_cost(task, truth, k, plant.x, command.value);
    for (std::uint32_t i = 0; i < nx; ++i)
      run.violated = run.violated || plant.x[i] < config.state_low[i] - task.slack ||
                     plant.x[i] > config.state_high[i] + task.slack;
    run.success = run.success && !(task.fails && task.fails(plant.x));
    sent.push_back(command);
    plant.advance(k >= task.delay_ticks ? sent[k - task.delay_ticks].value : idle.value);
    plant.disturb(random);
  }
  tiller_get_info(t, &info);
  run.probed = info.probed_ticks;
  run.spent = info.probe_spent;
  if (!std::isfinite(run.cost)) run.cost = 1e9;
  return run;
}

}  // namespace tiller::bench
