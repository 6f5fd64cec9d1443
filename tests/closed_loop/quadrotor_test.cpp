// The quadrotor in space on its simulated plant, in lockstep: the figure eight of its robot file, and recoveries from
// attitudes at which angles would be singular. Few seeds: `./dev bench quadrotor` has twenty.

#include <gtest/gtest.h>

#include <cmath>

#include "rollout/attitude.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/run/run_loop.hpp"

namespace tiller::tools {
namespace {

std::unique_ptr<RobotFile> open(std::uint64_t seed) {
  std::string error;
  auto robot = read_robot_file(TILLER_ROBOTS "/quadrotor.toml", error);
  EXPECT_NE(robot, nullptr) << error;
  robot->config.seed = robot->sim.seed = seed;
  robot->config.planner.deadline_us = 0;  // no clock: the same seed gives the same run
  return robot;
}

RunResult run(const RobotFile& robot, double seconds) {
  std::string error;
  const auto plant = make_sim_plant(robot, error);
  EXPECT_NE(plant, nullptr) << error;
  const auto link = make_sim_link(robot, *plant, false);
  RunOptions options;
  options.seconds = seconds;
  options.quiet = true;
  return run_robot(robot, *link, options);
}

TEST(Quadrotor, FliesTheFigureEight) {
  const auto robot = open(1);
  const RunResult result = run(*robot, 12.5);
  EXPECT_EQ(result.exit_code, 0);
  const std::vector<double>& x = result.last_true_state;
  ASSERT_EQ(x.size(), 13u);
  EXPECT_LT(std::hypot(x[0], x[1], x[2] - 1), 0.02) << "it ends where it began";
  // places alone cost 20 for a square metre: 0.2 where it is a tenth of a metre off all the way
  EXPECT_LT(result.cost, 0.2);
  EXPECT_TRUE(result.q05[0] < 0.9605 && 0.9597 < result.q95[0]) << "mass of seed 1: 0.9601 kg";
}

// From upside down, on its side, nose down and nose up, with a spin: all rest where they should within three seconds.
TEST(Quadrotor, RecoversFromEveryAttitude) {
  const double starts[][3] = {{M_PI, 0, 0}, {M_PI / 2, 0, 1}, {0, M_PI / 2, 0}, {0, -M_PI / 2, 2}, {3, 0.3, -2.5}};
  std::uint64_t seed = 0;
  for (const auto& [roll, pitch, yaw] : starts) {
    const auto robot = open(++seed);
    tiller::Config& c = robot->config;
    c.cost.reference = nullptr;
    c.cost.reference_steps = 0;
    write_quaternion(from_roll_pitch_yaw(roll, pitch, yaw), c.initial_state + 3);
    c.initial_state[10] = 2;
    for (std::uint32_t i = 0; i < 13; ++i) robot->sim.state[robot->states[i]] = c.initial_state[i];
    c.cost.target[2] = c.initial_state[2];
    const RunResult result = run(*robot, 3);
    EXPECT_EQ(result.exit_code, 0);
    ASSERT_EQ(result.last_true_state.size(), 13u);
    double off[13];
    state_differences(*c.model, result.last_true_state.data(), c.cost.target, off);
    std::printf("from roll %.2f, pitch %.2f, yaw %.2f: %.3f m, %.3f half radians off\n", roll, pitch, yaw,
                std::hypot(off[0], off[1], off[2]), std::hypot(off[4], off[5], off[6]));
    EXPECT_LT(std::hypot(off[0], off[1], off[2]), 0.3);
    EXPECT_LT(std::hypot(off[4], off[5], off[6]), 0.1);
  }
}

}  // namespace
}  // namespace tiller::tools
