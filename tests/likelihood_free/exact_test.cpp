// Against exact posteriors: a conjugate normal and a linear regression with normal priors.

#include "problems.hpp"

namespace tiller::tools {
namespace {

/// n readings of a constant with normal noise and a normal prior.
struct ConstantProblem {
  Config config;
  InferenceProblem problem;
  static constexpr int kReadings = 20;
  static constexpr double kSd = 0.5;

  explicit ConstantProblem(std::uint64_t seed) {
    config.param_count = 1;
    config.priors[0] = normal(0.0, 1.0);
    config.seed = seed;
    Piece piece{Vector::Zero(1), Matrix(0, kReadings), Matrix(1, kReadings)};
    Rng rng(seed, 200, 0);
    const double truth = rng.normal();
    for (int k = 0; k < kReadings; ++k) piece.measured(0, k) = truth + kSd * rng.normal();
    problem.pieces = {piece};
    problem.noise_sd = {kSd};
    problem.config = &config;
    problem.simulate = [](const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string&) {
      for (const Ask& ask : asks) answers.push_back({{Matrix::Constant(1, kReadings, ask.params(0))}, ""});
      return true;
    };
  }
  double exact_variance() const { return 1.0 / (1.0 + kReadings / (kSd * kSd)); }
  double exact_mean() const { return exact_variance() * problem.pieces[0].measured.sum() / (kSd * kSd); }
};

// Errors of the mean of 500 weighted draws: a twentieth of a deviation; of the deviation: a thirtieth.
TEST(SmcAbc, IsTheConjugateNormalsPosterior) {
  for (const std::uint64_t seed : {11u, 12u, 13u}) {
    ConstantProblem constant(seed);
    constant.problem.options.method = "smc_abc";
    constant.problem.options.simulations = 8000;
    constant.problem.options.particles = 400;
    Inferred result;
    std::string error;
    ASSERT_TRUE(infer(constant.problem, result, error)) << error;
    Vector mean;
    Matrix covariance;
    moments(result.found, 1, mean, covariance);
    const double sd = std::sqrt(constant.exact_variance());
    EXPECT_NEAR(mean(0), constant.exact_mean(), 0.2 * sd) << seed;
    EXPECT_NEAR(std::sqrt(covariance(0, 0)) / sd, 1.0, 0.15) << seed;
    EXPECT_LE(result.found.simulations, 8040u);  // 40 look for doubts
  }
}

TEST(SmcAbc, ItsToleranceFalls) {
  ConstantProblem constant(3);
  constant.problem.options.method = "smc_abc";
  Inferred result;
  std::string error;
  ASSERT_TRUE(infer(constant.problem, result, error)) << error;
  const auto& history = result.found.history;
  ASSERT_GE(history.size(), 3u);
  EXPECT_LT(history.back().discrepancy, 0.5 * history.front().discrepancy);
}

struct Judged {
  double kl;
  Inferred result;
};

/// Divergence of the method's moments from the exact posterior.
Judged judge(DriftProblem& drift, const std::string& method, const std::string& summary, std::uint32_t simulations,
             std::uint32_t rounds) {
  drift.problem.options.method = method;
  drift.problem.options.summary = summary;
  drift.problem.options.simulations = simulations;
  drift.problem.options.rounds = rounds;
  Judged out{};
  std::string error;
  EXPECT_TRUE(infer(drift.problem, out.result, error)) << error;
  Vector mean, exact_mean;
  Matrix covariance, exact_covariance;
  moments(out.result.found, 2, mean, covariance);
  drift.exact(exact_mean, exact_covariance);
  out.kl = divergence(mean, covariance, exact_mean, exact_covariance);
  return out;
}

// A shift of a quarter of a deviation costs .03 nats, widths a tenth off .01 each.
TEST(BayesSim, IsTheExactPosteriorOfALinearRegression) {
  DriftProblem drift(21, 30);
  EXPECT_LT(judge(drift, "bayes_sim", "linear", 2400, 3).kl, 0.1);
}

// The summary by hand is sufficient here too, but a network has to learn it.
TEST(BayesSim, LearnsFromCrossCorrelations) {
  DriftProblem drift(24, 30);
  EXPECT_LT(judge(drift, "bayes_sim", "cross_correlation", 2400, 3).kl, 0.3);
}

/// One reading y = 3 of a constant, prior and noise of deviation one: the posterior is N(1.5, 0.5).
void set_surprise(ConstantProblem& constant) {
  constant.problem.noise_sd = {1.0};
  constant.problem.pieces = {{Vector::Zero(1), Matrix(0, 1), Matrix::Constant(1, 1, 3.0)}};
  constant.problem.simulate = [](const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string&) {
    for (const Ask& ask : asks) answers.push_back({{Matrix::Constant(1, 1, ask.params(0))}, ""});
    return true;
  };
}

// Later rounds draw from N(1.5, 2) and its like. A density taught by those has its mean at 2.5 after two rounds and at
// 2.9 after three if nobody corrects it; multiplied by the prior alone it has .87 of the deviation; divided by the
// proposal alone it is the likelihood, N(3, 1).
TEST(BayesSim, DividesByTheProposalAndMultipliesByThePrior) {
  const double exact_sd = std::sqrt(0.5);
  double log_ratio = 0.0;
  for (const std::uint64_t seed : {61u, 62u}) {
    ConstantProblem constant(seed);
    set_surprise(constant);
    constant.problem.options.simulations = 3000;
    constant.problem.options.rounds = 3;
    constant.problem.options.components = 1;
    Inferred result;
    std::string error;
    ASSERT_TRUE(infer(constant.problem, result, error)) << error;
    Vector mean;
    Matrix covariance;
    moments(result.found, 1, mean, covariance);
    EXPECT_NEAR(mean(0), 1.5, 0.25 * exact_sd) << seed;
    log_ratio += std::log(std::sqrt(covariance(0, 0)) / exact_sd) / 2;
  }
  EXPECT_NEAR(std::exp(log_ratio), 1.0, 0.07);
}

TEST(RejectionAbc, IsCorrectedByRegression) {
  DriftProblem drift(25);
  const double plain = judge(drift, "abc", "linear", 5000, 1).kl;
  const double adjusted = judge(drift, "abc_regression", "linear", 5000, 1).kl;
  EXPECT_LT(adjusted, 0.3);
  EXPECT_LT(adjusted, 0.2 * plain);
}

}  // namespace
}  // namespace tiller::tools
