// Searches on small plants, the optimiser, and the policy file.

#include <gtest/gtest.h>

#include <cmath>

#include "core/rng.hpp"
#include "tools/policy_search/lbfgs.hpp"
#include "tools/policy_search/policy_file.hpp"
#include "tools/policy_search/reps_search.hpp"

namespace tiller::tools::policy {
namespace {

TEST(Lbfgs, FindsTheMinimumOfRosenbrocksValley) {
  const Objective valley = [](const Vector& x, Vector& gradient) {
    double value = 0;
    gradient.setZero();
    for (Eigen::Index i = 0; i + 1 < x.size(); ++i) {
      const double a = x(i + 1) - x(i) * x(i), b = 1.0 - x(i);
      value += 100.0 * a * a + b * b;
      gradient(i) += -400.0 * a * x(i) - 2.0 * b;
      gradient(i + 1) += 200.0 * a;
    }
    return value;
  };
  Vector x = Vector::Constant(6, -1.0);
  LbfgsOptions options;
  options.evaluations = 500;
  const LbfgsResult result = minimise(valley, x, options);
  EXPECT_LT(result.value, 1e-10);
  EXPECT_LT((x - Vector::Ones(6)).norm(), 1e-4);
}

/// A hinge with friction, 0.1 s a period, that a torque turns from 0 to 1 rad against a spring.
SearchTask hinge_task() {
  SearchTask task;
  task.states = 2;
  task.policy_inputs = task.model_inputs = {0, 1};
  task.low = Vector::Constant(1, -3.0);
  task.high = Vector::Constant(1, 3.0);
  task.start_mean = Vector::Zero(2);
  task.start_covariance = 0.0025 * Matrix::Identity(2, 2);
  task.horizon = 15;
  task.target = (Vector(2) << 1.0, 0.0).finished();
  task.weight = Vector((Vector(2) << 16.0, 0.1).finished()).asDiagonal();
  return task;
}

RunTrial hinge(const SearchTask& task, std::uint64_t seed) {
  return [task, seed](const Controller& controller, int index, Trial& trial, std::string&) {
    Rng rng(seed, 1, static_cast<std::uint64_t>(index));
    trial = {Matrix(2, task.horizon + 1), Matrix(2, task.horizon + 1), Matrix(1, task.horizon)};
    Vector x = 0.05 * (Vector(2) << rng.normal(), rng.normal()).finished();
    for (int k = 0; k <= task.horizon; ++k) {
      trial.truth.col(k) = x;
      trial.measured.col(k) = x + 0.005 * (Vector(2) << rng.normal(), rng.normal()).finished();
      if (k == task.horizon) break;
      trial.command.col(k) = controller(trial.measured.col(k), k);
      for (int s = 0; s < 10; ++s) {
        x(1) += 0.01 * (4.0 * trial.command(0, k) - 3.0 * std::sin(x(0)) - x(1));
        x(0) += 0.01 * x(1);
      }
    }
    return true;
  };
}

SearchOptions few(const char* kind) {
  SearchOptions options;
  options.trials = 3;
  options.kind = kind;
  options.bumps = 8;
  options.evaluations = 40;
  return options;
}

/// Costs by trial; every period costs nearly one where the hinge stays.
std::vector<double> costs_of(const SearchResult& result) {
  std::vector<double> costs;
  for (const SearchStep& step : result.steps) costs.push_back(step.cost);
  return costs;
}

TEST(Pilco, TurnsAHingeInThreeTrials) {
  const SearchTask task = hinge_task();
  const volatile std::sig_atomic_t never = 0;
  SearchResult result, again;
  std::string error;
  ASSERT_TRUE(pilco(task, hinge(task, 1), few("rbf"), {}, never, result, error)) << error;
  ASSERT_EQ(result.steps.size(), 4u);
  EXPECT_GT(result.steps.front().cost, 9.0);
  EXPECT_LT(result.steps.back().cost, 7.0);
  EXPECT_NEAR(result.steps.back().cost, result.steps.back().predicted,
              4.0);  // of 15; the rest is doubt after 60 transitions
  ASSERT_TRUE(pilco(task, hinge(task, 1), few("rbf"), {}, never, again, error)) << error;
  EXPECT_EQ(costs_of(result), costs_of(again));
}

TEST(Reps, TurnsTheHingeToo) {
  const SearchTask task = hinge_task();
  RepsOptions how;
  how.iterations = 15;
  how.samples = 30;
  const volatile std::sig_atomic_t never = 0;
  SearchResult result;
  std::string error;
  ASSERT_TRUE(reps_search(task, hinge(task, 1), few("linear"), how, {}, never, result, error)) << error;
  EXPECT_LT(result.steps.back().cost, 7.5);
}

Policy named(Policy p) {
  p.states = {"angle_rad", "rate_rad_s"};
  p.commands = {"torque_Nm"};
  p.features = {{Feature::kState, 1}, {Feature::kSine, 0}, {Feature::kCosine, 0}};
  p.low = Vector::Constant(1, -2.0);
  p.high = Vector::Constant(1, 3.0);
  return p;
}

Policy example(const std::string& kind) {
  Policy p;
  p.kind = kind;
  p.weight = (Matrix(1, 3) << 0.1, -0.7, 1.0 / 3.0).finished();
  p.bias = Vector::Constant(1, 0.2);
  p.bumps = {Matrix::Random(3, 4), 0.3 * Matrix::Random(3, 1), Vector::Zero(1), Matrix::Random(4, 1), {}};
  p.net = nets::Mlp({3, 5, 1});
  p.net.randomise(1);
  p.sine = kind != "tanh";
  return named(p);
}

TEST(PolicyFile, GivesBackEveryKind) {
  const Vector x = (Vector(2) << 0.4, -1.2).finished();
  for (const char* kind : {"linear", "rbf", "tanh"}) {
    const Policy before = example(kind);
    Policy after;
    std::string error;
    ASSERT_TRUE(parse_policy(policy_text(before, {0}), "p.json", after, error)) << error;
    EXPECT_NEAR(after.command(x)(0), before.command(x)(0), 1e-12) << kind;
    EXPECT_EQ(after.kind, before.kind == "linear" ? "tanh" : before.kind);  // a network without a hidden layer
  }
}

TEST(PolicyFile, TellsWhatIsWrong) {
  Policy policy;
  std::string error;
  std::string text = policy_text(example("rbf"), {0});
  EXPECT_FALSE(parse_policy("{", "p.json", policy, error));
  EXPECT_NE(error.find("p.json"), std::string::npos);
  text.replace(text.find("sin angle_rad"), 13, "sin angel_rad");
  EXPECT_FALSE(parse_policy(text, "p.json", policy, error));
  EXPECT_NE(error.find("network.inputs: are not the states"), std::string::npos) << error;
  text = policy_text(example("linear"), {0});
  text.replace(text.find("\"weights\""), 9, "\"weight\"");
  EXPECT_FALSE(parse_policy(text, "p.json", policy, error));
  EXPECT_NE(error.find("weights: is no list of 4 finite numbers"), std::string::npos) << error;
}

TEST(Policy, StaysWithinItsLimits) {
  for (const char* kind : {"linear", "rbf", "tanh"}) {
    Policy p = example(kind);
    p.weight *= 100.0;
    for (int i = -20; i <= 20; ++i) {
      const double u = p.command((Vector(2) << 0.3 * i, 2.0 * i).finished())(0);
      EXPECT_GE(u, -2.0);
      EXPECT_LE(u, 3.0);
    }
  }
}

}  // namespace
}  // namespace tiller::tools::policy
