#include "bench/planning/calibration_runs.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "bench/planning/lockstep.hpp"
#include "posterior/prior.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::bench {
namespace {

constexpr double kSines_Hz[] = {0.3, 0.7, 1.1, 1.7};
constexpr double kHandWidth = 0.8;  // of the box: a hand-made motion keeps a distance, for it is followed with an error

std::unique_ptr<tools::RobotFile> read(const std::string& name) {
  std::string errors;
  auto robot = tools::read_robot_file(std::string(TILLER_ROBOTS "/") + name + ".toml", errors);
  if (robot) return robot;
  std::fprintf(stderr, "%s\n", errors.c_str());
  std::exit(1);
}

bool is_position(const tiller_model_t& model, std::uint32_t state) {
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position == state) return true;
  return model.joint_count == 0;
}

/// Rows that sway in the positions of the box.
std::vector<double> multisine(const tools::RobotFile& robot, const CalibrationTask& task, std::uint32_t ticks,
                              RandomStream& random) {
  const tiller_config_t& c = robot.config;
  const std::uint32_t nx = c.model->state_count;
  std::vector<double> rows(std::size_t{ticks} * nx);
  for (std::uint32_t k = 0; k < ticks; ++k) std::copy(c.initial_state, c.initial_state + nx, rows.begin() + k * nx);
  for (const auto& interval : task.box) {
    const int state = tools::index_of(robot.names.states, interval.state);
    if (!is_position(*c.model, static_cast<std::uint32_t>(state))) continue;
    const double half = 0.5 * kHandWidth * (interval.high - interval.low) / std::size(kSines_Hz);
    for (const double hz : kSines_Hz) {
      const double phase = 6.283185307179586 * random.uniform();
      for (std::uint32_t k = 0; k < ticks; ++k)
        rows[k * nx + state] += half * std::sin(6.283185307179586 * hz * k * c.period_s + phase);
    }
  }
  return rows;
}

}  // namespace

const std::vector<CalibrationTask>& calibration_tasks() {
  static const std::vector<CalibrationTask> tasks = {
      {"pendulum", {{"angle_rad", -0.8, 0.8}, {"rate_rad_s", -6.0, 6.0}}},
      {"two_link_arm",
       {{"shoulder_rad", -0.3, 0.9},
        {"elbow_rad", -0.1, 1.1},
        {"shoulder_rad_s", -4.0, 4.0},
        {"elbow_rad_s", -4.0, 4.0}}},
      {"quadrotor",
       {{"x_m", -0.5, 0.5},
        {"y_m", -0.5, 0.5},
        {"z_m", 0.6, 1.4},
        {"x_m_s", -1.5, 1.5},
        {"y_m_s", -1.5, 1.5},
        {"z_m_s", -1.5, 1.5},
        {"attitude_x", -0.25, 0.25},
        {"attitude_y", -0.25, 0.25}}},
      {"skid_steer", {{"x_m", -1.0, 1.0}, {"y_m", -1.0, 1.0}}}};
  return tasks;
}

CalibrationRun run_calibration(const CalibrationTask& task, bool by_hand, std::uint64_t seed, double seconds) {
  const auto robot = read(task.robot);
  Config c = robot->config;
  const std::uint32_t nx = c.model->state_count, np = c.param_count;
  RandomStream random(seed);
  std::vector<double> truth(np);
  for (std::uint32_t i = 0; i < np; ++i)
    truth[i] = c.priors[i].kind == tiller_prior_fixed
                   ? c.priors[i].a
                   : from_coordinate(c.priors[i], prior_quantile(c.priors[i], random.uniform()));
  c.seed = seed;
  c.planner.deadline_us = 0;
  c.cost.reference = nullptr;
  c.cost.reference_steps = 0;
  std::copy(c.initial_state, c.initial_state + nx, c.cost.target);
  // the planner follows states
  c.cost.outputs = nullptr;
  c.cost.output_count = 0;
  for (const auto& interval : task.box) {
    const int state = tools::index_of(robot->names.states, interval.state);
    const double half = 0.5 * (interval.high - interval.low);
    if (state >= 0 && is_position(*c.model, static_cast<std::uint32_t>(state)))
      c.cost.state_weight[state] = c.cost.terminal_weight[state] = 10.0 / (half * half);
  }
  c.probe.weight = by_hand ? 0.0 : TILLER_SMALLEST_WEIGHT;
  const auto ticks = static_cast<std::uint32_t>(std::lround(seconds / c.period_s));
  const std::vector<double> rows = multisine(*robot, task, ticks, random);
  if (by_hand) {
    c.cost.reference = rows.data();
    c.cost.reference_steps = ticks;
  }
  double low[TILLER_MAX_STATES], high[TILLER_MAX_STATES];
  std::fill(low, low + nx, -HUGE_VAL);
  std::fill(high, high + nx, HUGE_VAL);
  for (const auto& interval : task.box) {
    const int state = tools::index_of(robot->names.states, interval.state);
    if (state < 0) {
      std::fprintf(stderr, "%s has no state %s\n", task.robot.c_str(), interval.state);
      std::exit(1);
    }
    low[state] = interval.low;
    high[state] = interval.high;
  }
  const LockstepController controller(task.robot, c);
  tiller_t* t = controller.get();
  const tiller_box_t box = {sizeof(tiller_box_t), TILLER_CONFIG_VERSION, low, high, nullptr, nullptr};
  if (!by_hand && tiller_calibrate(t, &box, ticks) != tiller_status_ok) std::exit(1);
  Plant plant(c, truth);
  CalibrationRun run;
  tiller_info_t info;
  for (std::uint32_t k = 0; k < ticks; ++k) {
    const std::int64_t now_us = std::llround(k * c.period_s * 1e6);
    const tiller_measurement_t m = plant.measure(now_us, k, random);
    tiller_command_t command{};
    const auto begin = std::chrono::steady_clock::now();
    (void)tiller_tick(t, now_us, &m, &command);
    run.tick_us += std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count() / ticks;
    bool outside = false;
    for (std::uint32_t i = 0; i < nx; ++i) outside = outside || plant.x[i] < low[i] || plant.x[i] > high[i];
    run.outside += outside ? 1.0 / ticks : 0.0;
    plant.advance(command.value);
    plant.disturb(random);
  }
  tiller_get_info(t, &info);
  for (std::uint32_t i = 0; i < np; ++i) {
    if (c.priors[i].kind == tiller_prior_fixed) continue;
    run.sd.push_back(info.param_sd[i]);
    run.error_sd = std::max(run.error_sd, std::fabs(info.param_mean[i] - truth[i]) / info.param_sd[i]);
  }
  return run;
}

}  // namespace tiller::bench
