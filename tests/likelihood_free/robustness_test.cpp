// Simulators that fail for some parameters, for all, and logs that no parameters explain; bounds; the same bits.

#include "problems.hpp"

namespace tiller::tools {
namespace {

const Words kMethods = {"bayes_sim", "smc_abc", "abc", "abc_regression"};

void set_small(InferenceProblem& problem, const std::string& method) {
  problem.options.method = method;
  problem.options.simulations = 1200;
  problem.options.rounds = 3;
  problem.options.particles = 200;
  problem.options.accept = 0.05;
}

TEST(Inference, GivesTheSameBitsAgain) {
  for (const std::string& method : kMethods) {
    DriftProblem drift(5);
    set_small(drift.problem, method);
    Inferred first, second;
    std::string error;
    ASSERT_TRUE(infer(drift.problem, first, error)) << error;
    ASSERT_TRUE(infer(drift.problem, second, error)) << error;
    EXPECT_EQ(first.found.params, second.found.params) << method;
    EXPECT_EQ(first.found.weight, second.found.weight) << method;
    drift.config.seed = 6;
    ASSERT_TRUE(infer(drift.problem, second, error)) << error;
    EXPECT_NE(first.found.params, second.found.params) << method;
  }
}

TEST(Inference, LeavesOutWhatFails) {
  for (const std::string& method : kMethods) {
    DriftProblem drift(7);
    set_small(drift.problem, method);
    const Simulator good = drift.problem.simulate;
    Vector exact;
    Matrix covariance;
    drift.exact(exact, covariance);
    const double limit = exact(0) + 1.0;  // far from where the posterior is
    drift.problem.simulate = [&](const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string& error) {
      if (!good(asks, answers, error)) return false;
      for (std::size_t k = 0; k < asks.size(); ++k) {
        if (asks[k].params(0) > limit) answers[k] = {{}, "too fast"};
        if (asks[k].params(0) > limit + 0.5) answers[k] = {{Matrix::Constant(1, 60, std::nan(""))}, ""};
      }
      return true;
    };
    Inferred result;
    std::string error;
    ASSERT_TRUE(infer(drift.problem, result, error)) << method << ": " << error;
    EXPECT_GT(result.found.diverged, 0u) << method;
    ASSERT_EQ(result.warnings.size(), 1u) << method;
    EXPECT_NE(result.warnings[0].find("simulations failed and count as impossible"), std::string::npos);
    for (std::size_t k = 0; k < result.found.count(); ++k)
      EXPECT_TRUE(std::isfinite(result.found.params[2 * k])) << method;
  }
}

TEST(Inference, StopsWhereAllFail) {
  for (const std::string& method : kMethods) {
    DriftProblem drift(7);
    set_small(drift.problem, method);
    drift.problem.simulate = [](const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string&) {
      answers.assign(asks.size(), {{}, "no mesh"});
      return true;
    };
    Inferred result;
    std::string error;
    EXPECT_FALSE(infer(drift.problem, result, error)) << method;
    EXPECT_NE(error.find("simulations failed, the first by: no mesh"), std::string::npos) << error;
  }
}

TEST(Inference, HandsTheSimulatorsErrorOn) {
  DriftProblem drift(7);
  drift.problem.simulate = [](const std::vector<Ask>&, std::vector<Simulated>&, std::string& error) {
    error = "it is gone";
    return false;
  };
  Inferred result;
  std::string error;
  EXPECT_FALSE(infer(drift.problem, result, error));
  EXPECT_EQ(error, "it is gone");
}

TEST(Inference, KeepsToTheBoundsOfThePrior) {
  for (const std::string& method : kMethods) {
    DriftProblem drift(8);
    set_small(drift.problem, method);
    Vector exact;
    Matrix covariance;
    drift.exact(exact, covariance);
    const double sd = std::sqrt(covariance(1, 1));
    drift.config.priors[1] = uniform(exact(1) - 0.3 * sd, exact(1) + 4.0);  // cuts through the posterior
    Inferred result;
    std::string error;
    ASSERT_TRUE(infer(drift.problem, result, error)) << method << ": " << error;
    double weight = 0.0;
    for (std::size_t k = 0; k < result.found.count(); ++k) {
      const double value = result.found.params[2 * k + 1];
      if (value < exact(1) - 0.3 * sd - 1e-12 || value > exact(1) + 4.0) weight += result.found.weight[k];
    }
    EXPECT_EQ(weight, 0.0) << method;
  }
}

TEST(BayesSim, TellsLogsThatNoParametersExplain) {
  DriftProblem drift(9);
  set_small(drift.problem, "bayes_sim");
  drift.problem.options.summary = "cross_correlation";
  drift.problem.pieces[0].measured.array() += 500.0;  // a jump at once: variance beyond all simulations
  Inferred result;
  std::string error;
  const bool good = infer(drift.problem, result, error);
  const std::string told = good ? join(result.warnings) : error;
  EXPECT_TRUE(told.find("no parameters of the simulator explain") != std::string::npos ||
              told.find("outside of what was simulated") != std::string::npos)
      << told;
}

TEST(Inference, RefusesWhatCannotWork) {
  const auto refused = [](const auto& change) {
    DriftProblem drift(5);
    set_small(drift.problem, "bayes_sim");
    change(drift);
    Inferred result;
    std::string error;
    EXPECT_FALSE(infer(drift.problem, result, error));
    return error;
  };
  EXPECT_NE(refused([](DriftProblem& d) { d.problem.pieces.clear(); }).find("no stretch"), std::string::npos);
  EXPECT_NE(refused([](DriftProblem& d) { d.problem.options.simulations = 100; }).find("raise --simulations to 180"),
            std::string::npos);
  EXPECT_NE(refused([](DriftProblem& d) {
              d.problem.options.summary = "recurrent";
              d.problem.options.method = "abc";
            }).find("'recurrent' is learnt together"),
            std::string::npos);
  EXPECT_NE(refused([](DriftProblem& d) {
              d.problem.options.method = "abc";
              d.problem.options.accept = 1e-3;
            }).find("raise --simulations or --accept"),
            std::string::npos);
}

}  // namespace
}  // namespace tiller::tools
