// The shipped robot files that are no cart-pole, on their ODE stand-ins in lockstep. Seeds 1..20 draw truth and noise.
// The bound of 19 of 20 is the one of the cart-pole.

#include <gtest/gtest.h>

#include <cmath>

#include "tools/plant_setup.hpp"
#include "tools/run_loop.hpp"

namespace tiller::tools {
namespace {

// Instrumented builds are twenty times slower: they check memory and threads, not statistics.
#ifdef TILLER_FEW_SEEDS
constexpr std::uint64_t kSeeds = 1;
#else
constexpr std::uint64_t kSeeds = 20;
#endif

struct Task {
  const char* file;
  double seconds;
  double within;       // of every position, m or rad; angles to the nearest turn
  double rate_within;  // of every rate
};

void PrintTo(const Task& task, std::ostream* out) { *out << task.file; }

/// The largest share of its tolerance that a state of the plant is off at the end; infinity for a run that failed.
double share_off(const Task& task, std::uint64_t seed) {
  std::string error;
  const auto robot = read_robot_file(std::string(TILLER_ROBOTS "/") + task.file, error);
  EXPECT_NE(robot, nullptr) << error;
  if (!robot) return INFINITY;
  robot->config.seed = robot->sim.seed = seed;
  robot->config.planner.deadline_us = 0;  // no clock: the same seed gives the same run
  const auto plant = make_sim_plant(*robot, error);
  EXPECT_NE(plant, nullptr) << error;
  if (!plant) return INFINITY;
  const auto link = make_sim_link(*robot, *plant, false);
  RunOptions options;
  options.seconds = task.seconds;
  options.quiet = true;
  const RunResult result = run_robot(*robot, *link, options);
  if (result.exit_code != 0) return INFINITY;
  const tiller_model_t& model = *robot->model;
  double worst = 0;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    double off = result.last_true_state[i] - robot->config.cost.target[i];
    if (model.angle_mask >> i & 1) off = std::remainder(off, 2 * M_PI);
    const bool rate = i >= model.state_count / 2;
    worst = std::fmax(worst, std::fabs(off) / (rate ? task.rate_within : task.within));
  }
  return worst;
}

class ShippedRobot : public testing::TestWithParam<Task> {};
// a place within 0.1 m counts as reached
INSTANTIATE_TEST_SUITE_P(Tasks, ShippedRobot, testing::Values(Task{"planar_quadrotor.toml", 6, 0.1, 0.5}),
                         [](const auto& info) {
                           const std::string name = info.param.file;
                           return name.substr(0, name.find('.'));
                         });

TEST_P(ShippedRobot, DoesItsTaskOnTwentySeeds) {
  std::uint64_t done = 0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const double off = share_off(GetParam(), seed);
    done += off < 1;
    std::printf("seed %2llu: %.2f of its tolerance off%s\n", static_cast<unsigned long long>(seed), off,
                off < 1 ? "" : ": NOT DONE");
  }
  EXPECT_GE(done, kSeeds - 1);
}

}  // namespace
}  // namespace tiller::tools
