// How deep a controller's calls go: the measuring itself, and the bound that docs/guide/targets.md tells.

#include "tools/doctor/stack_use.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

/// The bound of docs/guide/targets.md, a quarter of what `tiller run` touches before its first tick ([realtime]
/// stack_kB).
constexpr std::size_t kBound = 256 * 1024;

volatile unsigned char sink;

__attribute__((noinline)) void go_deep(std::size_t bytes) {
  auto* room = static_cast<volatile unsigned char*>(__builtin_alloca(bytes));
  for (std::size_t i = 0; i < bytes; i += 64) room[i] = 1;
  sink = room[bytes / 2];
}

TEST(StackUse, TellsTheDeepestCall) {
  PaintedStack stack(1 << 20);
  ASSERT_TRUE(stack.good());
  for (const std::size_t bytes : {std::size_t{1000}, std::size_t{100000}, std::size_t{20000}}) {
    stack.run([bytes] { go_deep(bytes); });
    const std::size_t deepest = std::max<std::size_t>(bytes, bytes == 20000 ? 100000 : 0);
    EXPECT_GE(stack.used(), deepest);
    EXPECT_LE(stack.used(), deepest + 4096);  // the frames on the way there
  }
}

void expect_within_bound(const tiller_config_t& given, const std::string& what, std::size_t init_bound = kBound) {
  tiller::Config config = given;
  config.posterior.window = 16;  // sooner full, no deeper
  const char* field = nullptr;
  if (tiller_config_check(&config, &field) != tiller_status_ok) return;  // not for this planner or engine
  StackUse use;
  std::string error;
  ASSERT_TRUE(measure_stack(config, 10, use, error)) << what << ": " << error;
  std::printf("%-60s init %6zu, tick %6zu bytes\n", what.c_str(), use.init_bytes, use.tick_bytes);
  EXPECT_LE(use.init_bytes, init_bound) << what;
  EXPECT_LE(use.tick_bytes, kBound) << what;
  EXPECT_GT(use.plans, 5u) << what;  // what does not plan takes little
}

TEST(StackUse, EveryRobotFileStaysWithinTheBound) {
  int robots = 0;
  for (const auto& entry : std::filesystem::directory_iterator(TILLER_TEST_ROBOTS)) {
    if (entry.path().extension() != ".toml") continue;
    std::string errors;
    const auto robot = read_robot_file(entry.path().string(), errors);
    ASSERT_TRUE(robot) << errors;
    expect_within_bound(robot->config, entry.path().filename().string());
    ++robots;
  }
  EXPECT_GE(robots, 8);
}

/// As many states, inputs, joints and parameters as a model may have: masses on rails, each pulled by a spring.
const tiller_model_t& largest_model() {
  constexpr std::uint32_t kMasses = TILLER_MAX_STATES / 2;
  static_assert(kMasses == TILLER_MAX_INPUTS && kMasses == TILLER_MAX_JOINTS, "one of each per mass");
  struct Names {
    std::vector<std::string> text;
    std::vector<const char*> at;
    explicit Names(const char* kind, std::uint32_t count) {
      for (std::uint32_t i = 0; i < count; ++i) text.push_back(kind + std::to_string(i));
      for (const std::string& name : text) at.push_back(name.c_str());
    }
  };
  static const Names states("x", 2 * kMasses), inputs("u", kMasses), params("p", TILLER_MAX_PARAMS),
      forces("f", kMasses);
  static const std::vector<tiller_joint_t> joints = [] {
    std::vector<tiller_joint_t> all;
    for (std::uint32_t i = 0; i < kMasses; ++i)
      all.push_back({states.at[i], static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(kMasses + i),
                     static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(i + 1)});
    return all;
  }();
  static const tiller_model_t model = [] {
    tiller_model_t m{};
    m.size = sizeof m;
    m.version = TILLER_MODEL_VERSION;
    m.name = "largest";
    m.state_count = 2 * kMasses;
    m.input_count = m.joint_count = kMasses;
    m.param_count = TILLER_MAX_PARAMS;
    m.state_names = states.at.data();
    m.input_names = inputs.at.data();
    m.param_names = params.at.data();
    m.force_names = forces.at.data();
    m.joints = joints.data();
    m.dynamics = [](const double* x, const double* u, const double* f, const tiller_body_t*, const double* p,
                    double* dxdt) {
      for (std::uint32_t i = 0; i < kMasses; ++i) {
        dxdt[i] = x[kMasses + i];
        dxdt[kMasses + i] = (p[2 * kMasses + i] * u[i] + f[i] - p[kMasses + i] * x[i]) / p[i] - p[3 * kMasses + i];
      }
    };
    return m;
  }();
  return model;
}

TEST(StackUse, TheLargestModelStaysWithinTheBoundWithEveryPlannerAndEngine) {
  tiller::Config c;
  ASSERT_EQ(tiller_config_default(&c, &largest_model()), tiller_status_ok);
  for (tiller_prior_t& prior : c.priors) prior = {tiller_prior_normal, 0, 1.0, 0.05, 0.5, 1.5};
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i) {
    c.safety.input_low[i] = -5.0;
    c.safety.input_high[i] = 5.0;
    c.planner.noise_sd[i] = 1.0;
    c.cost.input_weight[i] = 0.1;
  }
  c.measurement_count = TILLER_MAX_MEASUREMENTS;
  for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = c.process_sd[i] = c.initial_state_sd[i] = 0.01;
    c.cost.state_weight[i] = c.cost.terminal_weight[i] = 1.0;
  }
  c.period_s = 0.02;
  c.posterior.particles = 32;
  c.planner.horizon = 6;
  c.planner.rollouts = 32;
  c.planner.particles = 2;
  c.planner.levels = 3;
  c.planner.hold_steps = 2;
  for (std::uint32_t engine = 0; engine < tiller_posterior_kind_count; ++engine)
    for (std::uint32_t planner = 0; planner < tiller_planner_kind_count; ++planner) {
      c.posterior.kind = engine;
      c.planner.kind = planner;
      expect_within_bound(c,
                          "largest model, engine " + std::to_string(engine) + ", planner " + std::to_string(planner));
    }
  c.planner.kind = tiller_planner_ilqr;
  c.cost.terminal = tiller_terminal_lqr;
  expect_within_bound(c, "largest model, LQR beyond the horizon", 320 * 1024);
}

/// A bound of an image is told for what the image holds, and for nothing else.
TEST(StackUse, TellsTheBoundOfAnImageForItsModelAlone) {
  tiller::Config c;
  ASSERT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
  c.posterior.kind = tiller_posterior_filter;
  EXPECT_GT(stack_bound(c).init_bytes, stack_bound(c).tick_bytes);
  EXPECT_GT(stack_bound(c).tick_bytes, 0u);
  c.posterior.kind = tiller_posterior_transition;
  EXPECT_EQ(stack_bound(c).tick_bytes, 0u);
  ASSERT_EQ(tiller_config_default(&c, tiller_find_model("cart_pole")), tiller_status_ok);
  c.posterior.kind = tiller_posterior_filter;
  EXPECT_EQ(stack_bound(c).tick_bytes, 0u);
}

}  // namespace
}  // namespace tiller::tools
