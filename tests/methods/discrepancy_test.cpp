// The residual discrepancy of SimOpt, against values worked out by hand.
#include "tools/identify/discrepancy.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "problems.hpp"

namespace tiller::tools {
namespace {

constexpr double kPi = 3.141592653589793;

// Two steps of .1 s of dx/dt = a u + b v, dy/dt = b u - a v, logged as they are, whatever the model says.
TestLog two_steps() {
  TestLog log = linear_log(1, 0.7, 3);
  Grid& g = log.grids[0];
  g.state[0] = {0.0, 0.3, 0.1};
  g.state[1] = {0.0, 0.1, -0.2};
  g.input[0] = {1.0, 2.0, 0.0};
  g.input[1] = {0.0, 1.0, 0.0};
  return log;
}

// a = 1, b = 2 moves by (.1, .2) in the first step and by (.4, .3) in the second:
// from logged states, errors (-.2, .1) and (.6, .6); along a rollout, (-.2, .1) and (.4, .7).
const std::vector<double> kCandidate = {1.0, 2.0};

double discrepancy_of(const TestLog& log, const std::vector<double>& v, const DiscrepancyForm& form) {
  const MethodProblem problem = log.problem();
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  std::string error;
  EXPECT_TRUE(make_episodes(problem, episodes, error)) << error;
  return (*Discrepancy::make(problem, coordinates, episodes, form))(v, 1)[0];
}

TEST(ResidualDiscrepancy, IsTheSquaredErrorOfStepsByDefault) {
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, {}), (0.04 + 0.01 + 0.36 + 0.36) / 2, 1e-12);
}

TEST(ResidualDiscrepancy, WeighsAbsoluteAndSquaredErrors) {
  DiscrepancyForm form;
  form.weight_l1 = 1, form.weight_l2 = 0;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), (0.2 + 0.1 + 0.6 + 0.6) / 2, 1e-12);
  form.weight_l1 = 0.5, form.weight_l2 = 3;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), 0.5 * 0.75 + 3 * 0.385, 1e-12);
}

// RMS changes of the logs: x .3 and -.2, mean square .065; y .1 and -.3, mean square .05.
TEST(ResidualDiscrepancy, ScaleDividesByTheRmsDisplacement) {
  DiscrepancyForm form;
  form.scale = true;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), (0.40 / 0.065 + 0.37 / 0.05) / 2, 1e-12);
  form.weight_l1 = 2, form.weight_l2 = 0;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), 0.8 / std::sqrt(0.065) + 0.7 / std::sqrt(0.05), 1e-12);
}

TEST(ResidualDiscrepancy, ErrorsOfARolloutAddUp) {
  DiscrepancyForm form;
  form.steps = 0;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), (0.04 + 0.01 + 0.16 + 0.49) / 2, 1e-12);
  // displacements from the start: x .3 and .1, y .1 and -.2
  form.scale = true;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), (0.20 / 0.05 + 0.50 / 0.025) / 2, 1e-12);
}

// Of two errors a filter makes weighted means: its tap at one step is exp(-1/2 / s^2).
TEST(ResidualDiscrepancy, FilterAveragesErrorsOverTheRollout) {
  DiscrepancyForm form;
  form.steps = 0;
  form.smoothing_steps = 1.5;
  const double tap = std::exp(-0.5 / 2.25), sum = 1 + tap;
  const double x0 = (-0.2 + tap * 0.4) / sum, x1 = (0.4 - tap * 0.2) / sum;
  const double y0 = (0.1 + tap * 0.7) / sum, y1 = (0.7 + tap * 0.1) / sum;
  EXPECT_NEAR(discrepancy_of(two_steps(), kCandidate, form), (x0 * x0 + x1 * x1 + y0 * y0 + y1 * y1) / 2, 1e-12);
}

TEST(ResidualDiscrepancy, AnglesGoTheShortWayRound) {
  TestLog log = pendulum_log(1, 0.0, 3);
  Grid& g = log.grids[0];
  const double turn = 2 * kPi;
  const std::vector<double> v = {0.6, 0.5};
  const double before = discrepancy_of(log, v, {});
  g.state[0][1] += turn, g.state[0][2] -= turn;
  EXPECT_NEAR(discrepancy_of(log, v, {}), before, 1e-9 * before);
  EXPECT_GT(before, 0.0);
}

MethodResult run(const MethodProblem& problem, const char* method) {
  MethodResult result;
  std::string error;
  EXPECT_TRUE(find_method(method)->run(problem, result, error)) << error;
  return result;
}

MethodProblem few(const TestLog& log) {
  MethodProblem problem = log.problem();
  problem.options.simulations = 600;
  problem.options.iterations = 2;
  problem.options.rollout_s = 0.2;
  return problem;
}

TEST(SimOptForms, DefaultsAreWhatTheHelpSays) {
  const TestLog log = pendulum_log(2, 0.05, 81);
  const std::vector<double> steps = run(few(log), "simopt").params;
  const std::vector<double> trajectories = run(few(log), "trajectory_simopt").params;
  MethodProblem said = few(log);
  said.options.weight_l1 = 0, said.options.weight_l2 = 1, said.options.scale = false;
  EXPECT_EQ(run(said, "simopt").params, steps);
  said.options.weight_l1 = 1, said.options.scale = true;
  EXPECT_EQ(run(said, "trajectory_simopt").params, trajectories);
  EXPECT_NE(run(said, "simopt").params, steps);
  MethodProblem squares = few(log);
  squares.options.scale = true;
  EXPECT_NE(run(squares, "simopt").params, steps) << "radians and radians per second differ in size";
}

TEST(SimOptForms, NoWeightAtAllIsRefused) {
  const TestLog log = pendulum_log(3, 0.05, 81);
  MethodProblem problem = few(log);
  problem.options.weight_l2 = 0;
  MethodResult result;
  std::string error;
  EXPECT_FALSE(find_method("simopt")->run(problem, result, error));
  EXPECT_NE(error.find("--l1 0, --l2 0"), std::string::npos) << error;
  EXPECT_TRUE(find_method("trajectory_simopt")->run(problem, result, error)) << error;
}

}  // namespace
}  // namespace tiller::tools
