#include "bench/posterior/paper_tasks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "bench/problems/planning_problem.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/stage_cost.hpp"

namespace tiller::bench {
namespace {

tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, -INFINITY, INFINITY}; }
tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0.0, 0.0, low, high}; }

double centre(const tiller_prior_t& p) { return p.kind == tiller_prior_uniform ? 0.5 * (p.low + p.high) : p.a; }

/// Uniform on [-1, 1], drawn again every `hold` ticks.
class Push {
 public:
  Push(std::uint64_t seed, std::uint32_t hold, std::uint32_t channel)
      : rng_(seed, kInputStream, channel), hold_(hold) {}
  double at(std::uint32_t tick) {
    if (tick % hold_ == 0) value_ = 2.0 * rng_.uniform() - 1.0;
    return value_;
  }

 private:
  Rng rng_;
  std::uint32_t hold_;
  double value_ = 0.0;
};

const tools::RobotFile& hopper_file() {
  static const std::unique_ptr<tools::RobotFile> robot = [] {
    std::string errors;
    auto read = tools::read_robot_file(TILLER_ROBOTS "/hopper.toml", errors);
    if (!read) std::fprintf(stderr, "%s\n", errors.c_str()), std::exit(1);
    return read;
  }();
  return *robot;
}

/// The robot file's planner, which knows `params`.
tiller::Config hopper_planner(const std::vector<double>& params, std::uint64_t seed) {
  tiller::Config config = hopper_file().config;
  config.seed = seed;
  for (std::uint32_t i = 0; i < config.param_count; ++i) config.priors[i] = fixed(params[i]);
  config.planner.particles = 1;
  config.planner.deadline_us = 0;
  return config;
}

/// Plans from the true state; torques of up to `shove` Nm at the hip come on top, a new one every 50 ms.
CommandSource hopper_commands(const std::vector<double>& params, double shove, std::uint64_t seed) {
  const auto planning = std::make_shared<Planning>(hopper_planner(params, seed));
  return [planning, shove, push = Push(seed, 5, 1)](std::uint32_t tick, const double* x, double* u) mutable {
    planning->set_state(x);
    planning->plan();
    const tiller_safety_config_t& limits = planning->config.safety;
    planning->command[0] += shove * push.at(tick);
    for (int i = 0; i < 2; ++i)
      u[i] = planning->command[i] = std::clamp(planning->command[i], limits.input_low[i], limits.input_high[i]);
  };
}

std::vector<double> centres(const tiller_config_t& config) {
  std::vector<double> all;
  for (std::uint32_t i = 0; i < config.param_count; ++i) all.push_back(centre(config.priors[i]));
  return all;
}

PaperTask hopper(const char* name, std::initializer_list<tiller_prior_t> priors) {
  constexpr double kShove_Nm = 1.5;
  const tiller::Config& robot = hopper_file().config;
  PaperTask t;
  t.task = measured_task(name, *robot.model, {}, priors,
                         {0.0049, 0.0079, 0.0053, 0.034, 0.0078, 0.091, 0.21, 0.24, 3.1, 0.86});
  t.task.config.integrator = robot.integrator;
  t.task.config.substeps = robot.substeps;
  set_period(t.task, robot.period_s);
  std::copy_n(robot.initial_state, TILLER_MAX_STATES, t.task.config.initial_state);
  t.commands = [middle = centres(t.task.config)](std::uint64_t seed) {
    return hopper_commands(middle, kShove_Nm, seed);
  };
  return t;
}

}  // namespace

Episode PaperTask::episode(double sigma, std::uint32_t ticks, std::uint64_t seed) const {
  return commands ? make_episode(task, sigma, ticks, seed, commands(seed)) : make_episode(task, sigma, ticks, seed);
}

PaperTask slide_friction() {
  constexpr std::uint32_t kEvery = 50, kHit = 2;  // ticks
  PaperTask t;
  t.task = measured_task("slide friction", *tiller_find_model("linear_axis"), {{tiller_effect_coulomb_friction, 0}},
                         {fixed(1.0), uniform(1.0, 9.0)}, {0.0065, 0.094});
  t.commands = [](std::uint64_t seed) -> CommandSource {
    return [push = Push(seed, kEvery, 0)](std::uint32_t tick, const double*, double* u) mutable {
      const double force_N = 25.0 + 10.0 * push.at(tick);
      u[0] = tick % kEvery < kHit ? (tick / kEvery % 2 == 0 ? force_N : -force_N) : 0.0;
    };
  };
  return t;
}

PaperTask push_friction() {
  constexpr double kAhead_m_s = 0.03, kAside_m_s = 0.06, kBack_per_s = 1.0;
  const double half_length_m = 0.05, radius_m = 0.01;
  PaperTask t;
  t.task = measured_task("push friction", *tiller_find_model("pusher_slider"), {},
                         {uniform(0.1, 0.9), fixed(0.038), fixed(half_length_m), fixed(0.05), fixed(radius_m)},
                         {0.0013, 0.00088, 0.017, 0.0016, 0.0016});
  set_period(t.task, 0.05);
  t.task.config.initial_state[3] = -(half_length_m + radius_m);  // the finger at the middle of the face behind
  t.commands = [](std::uint64_t seed) -> CommandSource {
    return [push = Push(seed, 8, 0)](std::uint32_t tick, const double* x, double* u) mutable {
      const double cosine = std::cos(x[2]), sine = std::sin(x[2]);
      const double aside_m = cosine * (x[4] - x[1]) - sine * (x[3] - x[0]);  // in the box's axes
      const double aside_m_s = kAside_m_s * push.at(tick) - kBack_per_s * aside_m;
      u[0] = cosine * kAhead_m_s - sine * aside_m_s;
      u[1] = sine * kAhead_m_s + cosine * aside_m_s;
    };
  };
  return t;
}

PaperTask hopper_friction() {
  return hopper("hopper friction",
                {fixed(4.0), fixed(0.1), fixed(0.4), fixed(0.5), fixed(1500), fixed(15), uniform(0.2, 0.8)});
}

PaperTask hopper_three() {
  return hopper("hopper, three unknowns", {uniform(3.2, 4.8), fixed(0.1), fixed(0.4), fixed(0.5), uniform(1200, 1800),
                                           fixed(15), uniform(0.4, 1.0)});
}

double hopping_cost(const PaperTask& hopper, const std::vector<double>& truth, const std::vector<double>& params,
                    std::uint32_t ticks, std::uint64_t seed) {
  const tiller_config_t& config = hopper.task.config;
  const CommandSource command = hopper_commands(params, 0.0, seed);
  StepSetup setup;
  if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
  double x[TILLER_MAX_STATES], u[TILLER_MAX_INPUTS], sum = 0;
  double next[TILLER_MAX_STATES * kLanePadding], lanes[TILLER_MAX_PARAMS * kLanePadding];
  std::copy_n(config.initial_state, TILLER_MAX_STATES, x);
  for (std::size_t i = 0; i < truth.size(); ++i) std::fill_n(lanes + i * kLanePadding, kLanePadding, truth[i]);
  for (std::uint32_t k = 0; k < ticks; ++k) {
    command(k, x, u);
    sum += tools::stage_cost(hopper_file().config, k, x, u);
    step_lanes(config, setup, kLanePadding, x, lanes, u, next);
    for (std::uint32_t r = 0; r < hopper.task.states(); ++r) x[r] = next[r * kLanePadding];
  }
  return sum / ticks;
}

std::vector<PaperTask> paper_tasks() {
  std::vector<PaperTask> all;
  for (const AccuracyTask& task : accuracy_tasks()) all.push_back({task, {}});
  all.push_back(hopper_friction());
  all.push_back(push_friction());
  all.push_back(slide_friction());
  return all;
}

}  // namespace tiller::bench
