// How far a plan looks ahead is chosen from the model: a balancer that an import describes stands with the number that
// the import writes, and falls with the one of an arm.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>

#include "../planners/problem.hpp"
#include "tools/import/mechanism_task.hpp"
#include "tools/import/robot_writer.hpp"

namespace tiller::tools {
namespace {

constexpr double kCart_kg = 1.0, kPole_kg = 0.1, kHalf_m = 0.5, kEffort_N = 20.0;

/// A cart that is driven along a rail, with a rod that stands on it and that nothing drives.
bool read_balancer(Mechanism& mechanism) {
  const std::string path = ::testing::TempDir() + "horizon_test.urdf";
  std::ofstream(path)
      << "<robot name=\"balancer\"><link name=\"rail\"/><joint name=\"slide\" type=\"prismatic\">"
         "<parent link=\"rail\"/><child link=\"cart\"/><axis xyz=\"1 0 0\"/>"
         "<limit lower=\"-2\" upper=\"2\" effort=\"20\" velocity=\"10\"/></joint>"
         "<link name=\"cart\"><inertial><mass value=\"1\"/><inertia ixx=\"0.01\" iyy=\"0.01\" izz=\"0.01\"/>"
         "</inertial></link><joint name=\"lean\" type=\"continuous\"><parent link=\"cart\"/>"
         "<child link=\"rod\"/><axis xyz=\"0 1 0\"/></joint><link name=\"rod\"><inertial>"
         "<origin xyz=\"0 0 0.5\"/><mass value=\"0.1\"/>"
         "<inertia ixx=\"0.00833333\" iyy=\"0.00833333\" izz=\"0.0001\"/></inertial></link></robot>";
  Description description;
  std::vector<std::string> errors;
  if (!read_urdf(path, description, errors) || !build_mechanism(description, {}, mechanism, errors)) return false;
  mechanism.bodies[1].actuated = false;
  return true;
}

std::string written(const Mechanism& mechanism) {
  return write_robot(mechanism, {}, name_model(mechanism), "model.hpp", "", {}, {});
}
unsigned horizon_of(const std::string& text) {
  unsigned horizon = 0;
  const std::size_t at = text.find("\nhorizon = ");
  if (at != std::string::npos) (void)std::sscanf(text.c_str() + at, "\nhorizon = %u", &horizon);
  return horizon;
}

/// The import's task for the same machine as a built-in model; 0 leans nowhere.
tiller::Config balancer_config(std::uint32_t horizon) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("cart_pole")), tiller_status_ok);
  c.period_s = 0.01;
  c.integrator = tiller_integrator_midpoint;
  const double params[3] = {kCart_kg, kPole_kg, kHalf_m};
  for (int i = 0; i < 3; ++i) c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -HUGE_VAL, HUGE_VAL};
  c.planner.kind = tiller_planner_ilqr;
  c.planner.horizon = horizon;
  c.planner.particles = 1;
  c.planner.iterations = 2;
  c.cost.target[0] = 0.05;
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = i < 2 ? 10.0 : 0.1;
    c.cost.terminal_weight[i] = i < 2 ? 100.0 : 10.0;
  }
  c.cost.input_weight[0] = c.cost.input_rate_weight[0] = 0.1 / (kEffort_N * kEffort_N);
  c.safety.input_low[0] = -kEffort_N;
  c.safety.input_high[0] = kEffort_N;
  return c;
}

/// A rod on a cart, ten steps of semi-implicit Euler a period of 10 ms.
void step(double* x, double force_N) {
  for (int i = 0; i < 10; ++i) {
    const double s = std::sin(x[1]), c = std::cos(x[1]), all = kCart_kg + kPole_kg;
    const double push = (force_N + kPole_kg * kHalf_m * x[3] * x[3] * s) / all;
    const double turn = (9.81 * s - c * push) / (kHalf_m * (4.0 / 3.0 - kPole_kg * c * c / all));
    x[3] += 0.001 * turn;
    x[2] += 0.001 * (push - kPole_kg * kHalf_m * turn * c / all);
    x[0] += 0.001 * x[2];
    x[1] += 0.001 * x[3];
  }
}

/// Largest lean in the last of eight seconds.
double leans(std::uint32_t horizon) {
  const tiller::Config c = balancer_config(horizon);
  tiller_test::Bench bench(c, nullptr, select_rollout(*c.model));
  for (int i = 0; i < 3; ++i) bench.params[static_cast<std::size_t>(i)] = static_cast<float>(c.priors[i].a);
  double x[4] = {0.0, 0.01, 0.0, 0.0}, most = 0.0;
  for (int t = 0; t < 800; ++t) {
    bench.set_state({x[0], x[1], x[2], x[3]});
    (void)bench.plan();
    step(x, bench.command[0]);
    if (t >= 700) most = std::fmax(most, std::fabs(x[1]));
  }
  return most;
}

TEST(Horizon, ImportedBalancerStandsWithTheNumberThatIsWritten) {
  Mechanism mechanism;
  ASSERT_TRUE(read_balancer(mechanism));
  const std::string text = written(mechanism);
  const unsigned horizon = horizon_of(text);
  std::printf("horizon %u\n", horizon);
  EXPECT_GT(horizon, 40u);
  EXPECT_NE(text.find("slowest unstable mode"), std::string::npos) << text;
  EXPECT_LT(leans(horizon), 0.05);
  EXPECT_GT(leans(20), 0.2) << "it stands with an arm's horizon too: the test cannot fail";
}

TEST(Horizon, DrivenArmKeepsAShortPlan) {
  Mechanism mechanism;
  ASSERT_TRUE(read_balancer(mechanism));
  mechanism.bodies[1].actuated = true;
  mechanism.bodies[1].effort = 5.0;
  EXPECT_EQ(horizon_of(written(mechanism)), 20u);
}

/// The linear model against the textbook's: a rod on a cart that may move falls e-fold in sqrt(l (4/3 - m/M) / g).
TEST(Horizon, DescriptionFallsAsTheTextbookSays) {
  Mechanism mechanism;
  ASSERT_TRUE(read_balancer(mechanism));
  LinearTask task;
  task.period_s = 0.01;
  const std::vector<double> upright = start_position(mechanism);
  linearise_mechanism(mechanism, name_model(mechanism), upright, upright, task);
  double x[4] = {0.0, 1e-3, 0.0, 0.0};
  for (int k = 0; k < 100; ++k) {
    double next[4] = {};
    for (std::size_t r = 0; r < 4; ++r)
      for (std::size_t c = 0; c < 4; ++c) next[r] += task.target_a[4 * r + c] * x[c];
    std::copy(next, next + 4, x);
  }
  const double e_fold_s = std::sqrt(kHalf_m * (4.0 / 3.0 - kPole_kg / (kCart_kg + kPole_kg)) / 9.81);
  EXPECT_NEAR(x[1], 1e-3 * std::cosh(1.0 / e_fold_s), 1e-3 * x[1]);
}

/// A pendulum of half a kilogram on half a metre, 20 ms, semi-implicit Euler.
LinearTask pendulum_task(double torque_Nm) {
  LinearTask t;
  t.period_s = 0.02;
  t.states = 2;
  t.inputs = 1;
  const double inertia = 0.5 * 0.5 * 0.5, h = t.period_s;
  for (const double gravity : {-9.81 / 0.5, 9.81 / 0.5}) {
    auto& a = gravity < 0.0 ? t.start_a : t.target_a;
    auto& b = gravity < 0.0 ? t.start_b : t.target_b;
    a = {1.0 + h * h * gravity, h, h * gravity, 1.0};
    b = {h * h / inertia, h / inertia};
  }
  t.stage = {4.0, 0.05};
  t.terminal = {50.0, 2.0};
  t.effort = {0.01};
  t.reach = {torque_Nm};
  t.way = {M_PI, 0.0};
  return t;
}

/// 1.5 Nm deflect it by 0.61 rad: 2.6 half swings of 0.71 s, so that three would have to fit. At the top it falls
/// e-fold in 0.226 s, and a thousandfold in 1.56 s.
TEST(Horizon, WeakMotorHasToSwing) {
  const HorizonAdvice advice = advise_horizon(pendulum_task(1.5), 200);
  EXPECT_EQ(advice.needed, 75u) << advice.reason;
  EXPECT_NE(advice.reason.find("3 half swings of 0.71 s"), std::string::npos) << advice.reason;
}

TEST(Horizon, StrongMotorLiftsInOneGo) { EXPECT_LT(advise_horizon(pendulum_task(10.0), 200).needed, 20u); }

TEST(Horizon, SaysNothingOfWhatNothingHolds) {
  LinearTask task = pendulum_task(10.0);
  task.target_b = {0.0, 0.0};  // nothing drives it
  EXPECT_EQ(advise_horizon(task, 200).needed, 0u);
  task.target_a[0] = NAN;
  EXPECT_EQ(advise_horizon(task, 200).needed, 0u);
}

}  // namespace
}  // namespace tiller::tools
