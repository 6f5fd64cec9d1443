// Methods against what is known exactly: the posterior of a linear system, and the truth of a simulated one.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "problems.hpp"

namespace tiller::tools {
namespace {

Normal2 moments_of(const MethodResult& result) {
  Normal2 n;
  for (std::size_t s = 0; s < result.count(); ++s)
    for (std::size_t i = 0; i < 2; ++i) n.mean[i] += result.weight[s] * result.params[s * 2 + i];
  for (std::size_t s = 0; s < result.count(); ++s)
    for (std::size_t i = 0; i < 2; ++i)
      for (std::size_t j = 0; j < 2; ++j)
        n.cov[i][j] +=
            result.weight[s] * (result.params[s * 2 + i] - n.mean[i]) * (result.params[s * 2 + j] - n.mean[j]);
  return n;
}

/// KL divergence of the exact posterior from what was found, both taken as Gaussians.
double divergence(const Normal2& exact, const Normal2& found) {
  const double det = found.determinant();
  const double inv[2][2] = {{found.cov[1][1] / det, -found.cov[0][1] / det},
                            {-found.cov[1][0] / det, found.cov[0][0] / det}};
  double sum = std::log(det / exact.determinant()) - 2;
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j)
      sum += inv[i][j] * (exact.cov[j][i] + (found.mean[i] - exact.mean[i]) * (found.mean[j] - exact.mean[j]));
  return 0.5 * sum;
}

MethodResult run(const char* name, const MethodProblem& problem) {
  MethodResult result;
  std::string error;
  EXPECT_TRUE(find_method(name)->run(problem, result, error)) << name << ": " << error;
  return result;
}

double divergence_of(const char* method, unsigned seed, std::uint32_t simulations, double accept) {
  TestLog log = linear_log(seed);
  MethodProblem problem = log.problem();
  problem.options.simulations = simulations;
  problem.options.accept = accept;
  return divergence(exact_posterior(log), moments_of(run(method, problem)));
}

// With 30,000 draws the last of these accepts 150. Sampling alone then makes a divergence of about
// (d + d (d + 1) / 2) / (2 * 150) = .017; three times that is allowed for, and for what is left of the tolerance.
TEST(Abc, ApproachesTheExactPosteriorAsEpsilonFalls) {
  for (const unsigned seed : {1u, 2u}) {
    double last = INFINITY;
    for (const double accept : {1.0, 0.1, 0.005}) {
      const double now = divergence_of("abc", seed, 30000, accept);
      std::printf("  seed %u, share %.3f: divergence %.4f\n", seed, accept, now);
      EXPECT_LT(now, 0.6 * last) << "seed " << seed << ", share " << accept;
      last = now;
    }
    EXPECT_LT(last, 0.05);
  }
}

// Keeping everything is the prior itself, to its sampling error of 2.5 / 20,000 and the rounding of quantiles.
TEST(Abc, EverythingAcceptedIsThePrior) {
  TestLog log = linear_log(4);
  MethodProblem problem = log.problem();
  problem.options.simulations = 20000;
  problem.options.epsilon = 1e9;
  const MethodResult result = run("abc", problem);
  EXPECT_EQ(result.count(), 20000u);
  const Normal2 prior{{0.5, 0.5}, {{1, 0}, {0, 1}}};
  EXPECT_LT(divergence(prior, moments_of(result)), 0.001);
}

// So is a joint prior: two components, correlated, with the moments of their mixture.
TEST(Abc, EverythingAcceptedIsTheJointPriorWhereThereIsOne) {
  TestLog log = linear_log(4);
  const double share[2] = {0.5, 0.5}, mean[4] = {0.0, 0.0, 1.0, 2.0}, root[8] = {0.5, 0, 0.3, 0.4, 0.5, 0, 0.3, 0.4};
  const tiller_mixture_t mixture = {sizeof(tiller_mixture_t), TILLER_CONFIG_VERSION, 2, 2, share, mean, root};
  log.config.prior_mixture = &mixture;
  MethodProblem problem = log.problem();
  problem.options.simulations = 20000;
  problem.options.epsilon = 1e9;
  // within: root root' = {.25, .15; .15, .25}; between: the means are +-(.5, 1) from theirs
  const Normal2 exact{{0.5, 1.0}, {{0.25 + 0.25, 0.15 + 0.5}, {0.15 + 0.5, 0.25 + 1.0}}};
  EXPECT_LT(divergence(exact, moments_of(run("abc", problem))), 0.001);
}

// On a linear system the regression is exact, so what remains is sampling: about 2.5 / ESS, 2.5 / 750 here.
TEST(AbcRegression, BeatsRejection) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    const double rejection = divergence_of("abc", seed, 10000, 0.1);
    const double regression = divergence_of("abc_regression", seed, 10000, 0.1);
    std::printf("  seed %u: rejection %.4f, regression %.4f\n", seed, rejection, regression);
    EXPECT_LT(regression, 0.2 * rejection) << "seed " << seed;
    EXPECT_LT(regression, 0.02);
  }
}

struct Case {
  const char* method;
  double tolerance;  // relative, of mass and length
};

// 200 transitions whose noise leaves 1 % (see the posterior's row) in the parameters; trajectories accumulate it over
// rollouts of 2 s, and their discrepancy is no likelihood, so they are allowed 10 %.
TEST(SimOpt, FindsThePendulum) {
  for (const Case& c : {Case{"trajectory_simopt", 0.1}, Case{"simopt", 0.03}}) {
    for (const unsigned seed : {1u, 2u, 3u, 4u, 5u}) {
      const TestLog log = pendulum_log(seed);
      const MethodResult result = run(c.method, log.problem());
      const MethodIteration &first = result.history.front(), &last = result.history.back();
      std::printf("  %s, seed %u: mass %.4f +- %.4f, length %.4f +- %.4f\n", c.method, seed, last.mean[0], last.sd[0],
                  last.mean[1], last.sd[1]);
      EXPECT_NEAR(last.mean[0], 0.4, 0.4 * c.tolerance) << c.method << ", seed " << seed;
      EXPECT_NEAR(last.mean[1], 0.7, 0.7 * c.tolerance) << c.method << ", seed " << seed;
      EXPECT_LT(last.discrepancy, first.discrepancy);
      EXPECT_EQ(result.history.size(), 10u);
      for (const MethodIteration& i : result.history) EXPECT_NEAR(i.kl, 1.0, 1e-6) << "each iteration uses its bound";
    }
  }
}

// docs/theory/methods.md warns of this: iterations narrow the Gaussian whether or not there are data for it.
TEST(SimOpt, ShrinksWithEveryIterationWhateverTheDataTell) {
  const TestLog log = pendulum_log(6, 0.05, 21);  // a tenth of the data
  const MethodResult result = run("simopt", log.problem());
  for (std::size_t i = 2; i < result.history.size(); ++i)
    EXPECT_LT(result.history[i].sd[1], result.history[i - 1].sd[1]);
  EXPECT_LT(result.history.back().sd[1], 0.01 * 0.26) << "a hundredth of the prior's deviation";
}

TEST(Reps, WeighsPriorDrawsOnce) {
  const TestLog log = pendulum_log(7);
  MethodProblem problem = log.problem();
  problem.options.kl = 4.0;
  const MethodResult result = run("reps", problem);
  EXPECT_EQ(result.count(), 10000u);
  EXPECT_NEAR(result.history.back().kl, 4.0, 1e-6);
  EXPECT_NEAR(result.history.back().mean[1], 0.7, 3 * result.history.back().sd[1]);
  EXPECT_LT(result.history.back().sd[1], 0.15) << "prior .26";
}

TEST(Posterior, IsAMethodAmongOthers) {
  TestLog log = pendulum_log(8);
  for (double& sd : log.config.measurement_sd) sd = 1e-4;
  MethodProblem problem = log.problem();
  problem.options.particles = 256;
  const MethodResult result = run("posterior", problem);
  const MethodIteration& last = result.history.back();
  EXPECT_NEAR(last.mean[0], 0.4, 4 * last.sd[0]);
  EXPECT_NEAR(last.mean[1], 0.7, 4 * last.sd[1]);
  EXPECT_TRUE(std::isfinite(result.noise_scale));
}

}  // namespace
}  // namespace tiller::tools
