// What the Python package is compared with: a loop through the C interface, and the rollout kernel itself.
//
//   bench_package commands ROBOT TICKS        a closed loop; a line a tick: now_us, measurement and command, exact
//   bench_package ticks ROBOT TICKS           nanoseconds a tick, median, on the same measurements: JSON
//   bench_package rollout ROBOT LANES STEPS   nanoseconds a lane and step of the kernel alone, fastest of rounds: JSON
//
// The plant is the model itself (TrialPlant): what is compared is two callers, not two models.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/links/trial_plant.hpp"
#include "tools/open/robot_open.hpp"

namespace {

using namespace tiller;
using namespace tiller::tools;
using Clock = std::chrono::steady_clock;

double ns_since(Clock::time_point begin) {
  return static_cast<double>(std::chrono::nanoseconds(Clock::now() - begin).count());
}

std::unique_ptr<RobotFile> open_robot(const char* path) {
  std::string errors;
  auto robot = read_robot_file(path, errors);
  if (robot) return robot;
  std::fprintf(stderr, "%s", errors.c_str());
  std::exit(1);
}

/// A controller without a deadline, armed; the block lives as long as the program.
tiller_t* make_controller(const RobotFile& robot, Config& config) {
  config = robot.config;
  config.planner.deadline_us = 0;
  const std::size_t size = tiller_size(&config);
  void* block =
      std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT);
  tiller_t* t = nullptr;
  const tiller_status_t status = tiller_init(&t, &config, nullptr, block, size);
  if (status == tiller_status_ok && tiller_arm(t) == tiller_status_ok) return t;
  std::fprintf(stderr, "%s: %s\n", robot.path.c_str(), tiller_status_text(status));
  std::exit(1);
}

/// Each tick's measurement, command and time.
struct Loop {
  std::vector<tiller_measurement_t> measured;
  std::vector<tiller_command_t> commands;
  std::vector<double> ns;
};

Loop run_loop(const RobotFile& robot, int ticks) {
  Config config;
  tiller_t* t = make_controller(robot, config);
  TrialPlant plant(config, 4 * config.substeps);
  Loop loop;
  for (int k = 0; k < ticks; ++k) {
    loop.measured.push_back(plant.measure(static_cast<std::uint32_t>(k)));
    const tiller_measurement_t& m = loop.measured.back();
    loop.commands.emplace_back();
    const auto begin = Clock::now();
    (void)tiller_tick(t, m.stamp_us, &m, &loop.commands.back());
    loop.ns.push_back(ns_since(begin));
    plant.step(loop.commands.back().value);
  }
  return loop;
}

int print_commands(const RobotFile& robot, int ticks) {
  const Loop loop = run_loop(robot, ticks);
  for (std::size_t k = 0; k < loop.commands.size(); ++k) {
    std::printf("%lld", static_cast<long long>(loop.measured[k].stamp_us));
    for (std::size_t i = 0; i < robot.names.measurements.size(); ++i) std::printf(" %a", loop.measured[k].value[i]);
    std::printf(" ;");
    for (std::size_t i = 0; i < robot.names.inputs.size(); ++i) std::printf(" %a", loop.commands[k].value[i]);
    std::printf("\n");
  }
  return 0;
}

int time_ticks(const RobotFile& robot, int ticks) {
  Loop loop = run_loop(robot, ticks);
  std::nth_element(loop.ns.begin(), loop.ns.begin() + ticks / 2, loop.ns.end());
  std::printf("{\"tick_ns\": %.1f}\n", loop.ns[static_cast<std::size_t>(ticks / 2)]);
  return 0;
}

/// The kernel on rows of lanes, a piece at a time as the package has them: the work without anybody's interface.
int time_kernel(const RobotFile& robot, int lanes, int steps) {
  constexpr std::uint32_t kPiece = 32;
  const std::size_t nx = robot.names.states.size(), nu = robot.names.inputs.size();
  StepSetup setup;
  if (make_step_setup(robot.config, setup) != tiller_status_ok) return 1;
  std::vector<double> params, state(nx, 0.1), effects(setup.effect_state_count + 1, 0.0);
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) params.push_back(centre_of(robot.config.priors[i]));
  const std::size_t pieces = (static_cast<std::size_t>(lanes) + kPiece - 1) / kPiece,
                    rows = nx * (static_cast<std::size_t>(steps) + 1);
  std::vector<double> controls(pieces * static_cast<std::size_t>(steps) * nu * kPiece), way(pieces * rows * kPiece);
  for (std::size_t i = 0; i < controls.size(); ++i) controls[i] = 0.01 * static_cast<double>(i % 97) - 0.5;
  std::vector<double> history((std::size_t{setup.delay_steps} + 1) * nu, 0.0);
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = kPiece;
  job.horizon = static_cast<std::uint32_t>(steps);
  job.state.data = state.data();
  job.params.data = params.data();
  job.effect_state.data = effects.data();
  job.history = history.data();
  job.controls.stride = kPiece;
  double best = 1e300;
  for (int round = 0; round < 9; ++round) {
    const auto begin = Clock::now();
    for (std::size_t p = 0; p < pieces; ++p) {
      job.controls.data = controls.data() + p * static_cast<std::size_t>(steps) * nu * kPiece;
      job.trajectory = way.data() + p * rows * kPiece;
      select_rollout(*robot.config.model).rollout_f64(*robot.config.model, job);
    }
    best = std::min(best, ns_since(begin));
  }
  std::printf("{\"kernel_ns\": %.3f, \"last\": %.17g}\n", best / (static_cast<double>(lanes) * steps), way.back());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "bench_package commands|ticks ROBOT TICKS, or rollout ROBOT LANES STEPS\n");
    return 1;
  }
  const auto robot = open_robot(argv[2]);
  const int count = std::max(1, std::atoi(argv[3]));
  if (std::strcmp(argv[1], "commands") == 0) return print_commands(*robot, count);
  if (std::strcmp(argv[1], "ticks") == 0) return time_ticks(*robot, count);
  return time_kernel(*robot, count, argc > 4 ? std::max(1, std::atoi(argv[4])) : 50);
}
