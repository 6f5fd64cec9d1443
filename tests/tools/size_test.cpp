// tiller size: its parts are the whole block, its counts are what the configuration asks for, and its estimate meets
// what the emulated Cortex-M7 took.

#include <gtest/gtest.h>

#include <filesystem>

#include "abi/controller.hpp"
#include "executive/part_sizes.hpp"
#include "swing_up.hpp"
#include "tiller/config.hpp"
#include "tools/doctor/work_count.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

PartSizes parts_of(const tiller_config_t& config) {
  PartSizes parts;
  Arena arena;
  (void)arena.take<tiller_controller>(1);
  (void)Executive::lay_out(arena, config, nullptr, &parts);
  return parts;
}

TEST(Size, PartsAreTheWholeBlockForEveryRobotAndPlanner) {
  int checked = 0;
  for (const auto& entry : std::filesystem::directory_iterator(TILLER_TEST_ROBOTS)) {
    if (entry.path().extension() != ".toml") continue;
    std::string errors;
    const auto robot = read_robot_file(entry.path().string(), errors);
    ASSERT_TRUE(robot) << errors;
    for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
      tiller::Config config = robot->config;
      config.planner.kind = kind;
      const std::size_t size = tiller_size(&config);
      if (size == 0) continue;  // this planner cannot do what the file asks for
      const PartSizes parts = parts_of(config);
      std::size_t sum = 0;
      for (std::uint32_t i = 0; i < parts.count; ++i) sum += parts.part[i].bytes;
      EXPECT_EQ(sum, size) << entry.path() << " planner " << kind;
      EXPECT_LT(parts.count, PartSizes::kMost);
      ++checked;
    }
  }
  EXPECT_GE(checked, 40);
}

TEST(Size, CountsFollowTheConfiguration) {
  tiller::Config config = swing_up::config(swing_up::kSwingUp);
  ModelWork once, twice, most;
  std::string error;
  ASSERT_TRUE(count_work(config, 20, once, most, error)) << error;
  const tiller_planner_config_t& p = config.planner;
  const std::uint64_t samples = std::uint64_t{p.rollouts} * p.particles * p.horizon * p.iterations;
  EXPECT_GE(once.rollout_f32, samples);
  // beside them the old plan and the new one are judged, a few sequences in sixteen lanes each
  EXPECT_LE(once.rollout_f32, samples + 2ull * 16 * p.particles * p.horizon);
  EXPECT_GE(once.linearise, std::uint64_t{config.posterior.particles});
  EXPECT_EQ(once.path_linearise, 0u);

  config.substeps = 2;
  ASSERT_TRUE(count_work(config, 20, twice, most, error)) << error;
  EXPECT_EQ(twice.rollout_f32, 2 * once.rollout_f32);
  EXPECT_GE(most.steps(), twice.steps());

  ModelWork gradient;
  ASSERT_TRUE(count_work(swing_up::config(swing_up::kHold), 20, gradient, most, error)) << error;
  EXPECT_GE(gradient.path_linearise, std::uint64_t{p.horizon});
  EXPECT_GT(gradient.path_feedback, 0u);
}

/// Measured by ./dev cross: mean instructions per tick over 10,000 ticks, plant included. A change that halves or
/// doubles the work of a tick makes this fail: measure again.
TEST(Size, EstimateIsWithinAThirdOfTheEmulatedProcessor) {
  struct Case {
    swing_up::Task task;
    double measured;
  };
  for (const Case& c : {Case{swing_up::kSwingUp, 5.4e6}, Case{swing_up::kHold, 2.5e6}}) {
    const tiller::Config config = swing_up::config(c.task);
    ModelWork mean, most;
    std::string error, stand_in;
    ASSERT_TRUE(count_work(config, 50, mean, most, error)) << error;
    const double estimate = kBesideSteps * mean.instructions(config, stand_in);
    std::printf(
        "%s: %.2f million estimated, %.2f measured; %llu f32, %llu f64, %llu d/dx, %llu + %llu along the plan\n",
        c.task.name, 1e-6 * estimate, 1e-6 * c.measured, static_cast<unsigned long long>(mean.rollout_f32),
        static_cast<unsigned long long>(mean.rollout_f64), static_cast<unsigned long long>(mean.linearise),
        static_cast<unsigned long long>(mean.path_linearise), static_cast<unsigned long long>(mean.path_feedback));
    EXPECT_TRUE(stand_in.empty());
    EXPECT_GT(estimate, c.measured / 1.33) << c.task.name;
    EXPECT_LT(estimate, c.measured * 1.33) << c.task.name;
  }
}

}  // namespace
}  // namespace tiller::tools
