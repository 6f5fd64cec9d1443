// Every line of methods.def: bits, bounds, diverging candidates, and logs that cannot be learnt from.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "problems.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

bool is_posterior(const Method& method) { return std::strcmp(method.name, "posterior") == 0; }

MethodProblem quick(const TestLog& log) {
  MethodProblem problem = log.problem();
  problem.options.simulations = 2000;
  problem.options.iterations = 5;
  problem.options.particles = 128;
  problem.options.window = 32;
  return problem;
}

class EveryMethod : public testing::TestWithParam<std::size_t> {
 protected:
  const Method& method() const { return methods()[GetParam()]; }
  void TearDown() override { wall = std::numeric_limits<double>::infinity(); }
  MethodResult run(const MethodProblem& problem) const {
    MethodResult result;
    std::string error;
    EXPECT_TRUE(method().run(problem, result, error)) << error;
    return result;
  }
  std::string error_of(const MethodProblem& problem) const {
    MethodResult result;
    std::string error;
    EXPECT_FALSE(method().run(problem, result, error)) << method().name;
    return error;
  }
};

TEST_P(EveryMethod, IsFoundByName) {
  EXPECT_EQ(find_method(method().name), &method());
  EXPECT_GT(std::strlen(method().help), 10u);
  EXPECT_GT(std::strlen(method().citation), 10u);
  EXPECT_NE(method_names().find(method().name), std::string::npos);
  EXPECT_EQ(find_method("no such method"), nullptr);
}

TEST_P(EveryMethod, SameSeedSameBits) {
  TestLog log = pendulum_log(21);
  for (double& sd : log.config.measurement_sd) sd = 1e-4;
  const MethodResult a = run(quick(log)), b = run(quick(log));
  EXPECT_EQ(a.params, b.params);
  EXPECT_EQ(a.weight, b.weight);
  log.config.seed = 2;
  EXPECT_NE(a.params, run(quick(log)).params);
}

TEST_P(EveryMethod, WeightsAreWeightsAndBoundsHold) {
  TestLog log = pendulum_log(22);
  for (double& sd : log.config.measurement_sd) sd = 1e-4;
  log.config.priors[0] = {tiller_prior_log_normal, 0, 0.3, 0.5, 0.1, 0.41};  // the truth is .4
  log.config.priors[1] = {tiller_prior_normal, 0, 0.5, 0.3, 0.2, 0.71};      // and .7
  const MethodResult result = run(quick(log));
  double sum = 0;
  for (std::size_t s = 0; s < result.count(); ++s) {
    ASSERT_GE(result.weight[s], 0.0);
    sum += result.weight[s];
    ASSERT_GE(result.params[s * 3], 0.1 * (1 - 1e-6));
    ASSERT_LE(result.params[s * 3], 0.41 * (1 + 1e-6));
    ASSERT_GE(result.params[s * 3 + 1], 0.2 * (1 - 1e-6));
    ASSERT_LE(result.params[s * 3 + 1], 0.71 * (1 + 1e-6));
    ASSERT_NEAR(result.params[s * 3 + 2], 0.02, 1e-6);  // fixed; the posterior's draws are floats
  }
  EXPECT_NEAR(sum, 1.0, 1e-9);
  EXPECT_FALSE(result.history.empty());
  EXPECT_GT(result.transitions, 100u);
}

// Half of the prior diverges: those have no weight, and what is left is as good as ever.
TEST_P(EveryMethod, CandidatesThatDivergeDoNotPoison) {
  if (is_posterior(method())) GTEST_SKIP() << "tests/posterior has it";
  const TestLog log = linear_log(23, 0.05);
  wall = 1.1;  // the truth is .9, the prior N(.5, 1)
  const MethodResult result = run(quick(log));
  EXPECT_GT(result.diverged, 100u);
  for (std::size_t s = 0; s < result.count(); ++s) {
    ASSERT_TRUE(std::isfinite(result.params[s * 2]) && std::isfinite(result.weight[s]));
    if (result.params[s * 2] > wall && std::strcmp(method().name, "reps") == 0) {
      ASSERT_EQ(result.weight[s], 0.0);
    }
  }
  const double reach = std::strcmp(method().name, "reps") == 0 ? 1.0 : 0.3;
  EXPECT_NEAR(result.history.back().mean[0], 0.9, reach);
}

TEST_P(EveryMethod, AllDivergedIsAnError) {
  if (is_posterior(method())) GTEST_SKIP() << "tests/posterior has it";
  const TestLog log = linear_log(24);
  wall = -100;
  EXPECT_NE(error_of(quick(log)).find("finite"), std::string::npos);
}

TEST_P(EveryMethod, LogsWithoutPointsAreAnError) {
  if (is_posterior(method())) GTEST_SKIP() << "reads stretches";
  TestLog log = linear_log(25);
  log.grids.clear();
  EXPECT_NE(error_of(quick(log)).find("no stretch"), std::string::npos);
}

TEST_P(EveryMethod, LogsWithoutStatesAreAnError) {
  if (is_posterior(method())) GTEST_SKIP() << "reads stretches";
  TestLog log = linear_log(26);
  for (double& v : log.grids[0].state[1]) v = kNaN;
  EXPECT_NE(error_of(quick(log)).find("every state is known"), std::string::npos);
}

// Three of four rows lost: what is left in pairs still serves.
TEST_P(EveryMethod, MissingValuesAreLeftOut) {
  if (is_posterior(method())) GTEST_SKIP() << "tests/posterior has it";
  TestLog log = linear_log(27, 0.3, 161);
  for (std::size_t p = 0; p < 161; ++p)
    if (p % 8 > 1) log.grids[0].state[0][p] = kNaN;
  const MethodResult result = run(quick(log));
  EXPECT_LT(result.transitions, 80u);
  EXPECT_TRUE(std::isfinite(result.history.back().mean[0]));
}

INSTANTIATE_TEST_SUITE_P(Methods, EveryMethod, testing::Range(std::size_t{0}, methods().size()),
                         [](const auto& instance) { return std::string(methods()[instance.param].name); });

TEST(Methods, HiddenStatesAreRefusedWhereTheyCannotBeSimulated) {
  TestLog log = pendulum_log(28);
  log.config.measurement_count = 1;  // the angle alone
  log.config.measurement_sd[0] = 1e-4;
  MethodResult result;
  std::string error;
  EXPECT_FALSE(find_method("abc")->run(quick(log), result, error));
  EXPECT_NE(error.find("not every state has a sensor"), std::string::npos);
  // both forms of SimOpt take the rate from the angles around each point
  for (double& v : log.grids[0].state[1]) v = kNaN;
  EXPECT_TRUE(find_method("trajectory_simopt")->run(quick(log), result, error)) << error;
  EXPECT_NEAR(result.history.back().mean[1], 0.7, 0.15);
}

TEST(Methods, ToleranceThatAcceptsNothingSaysWhatWouldBeAccepted) {
  const TestLog log = linear_log(29);
  MethodProblem problem = quick(log);
  problem.options.epsilon = 1e-9;
  for (const char* name : {"abc", "abc_regression"}) {
    MethodResult result;
    std::string error;
    EXPECT_FALSE(find_method(name)->run(problem, result, error));
    EXPECT_NE(error.find("raise --epsilon"), std::string::npos) << error;
  }
}

}  // namespace
}  // namespace tiller::tools
