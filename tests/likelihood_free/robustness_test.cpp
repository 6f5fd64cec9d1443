// Simulators that fail for some parameters, for all, and logs that no parameters explain; bounds; the same bits.

#include "problems.hpp"
#include "tools/identify/coordinates.hpp"
#include "tools/likelihood_free/doubts.hpp"

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
    drift.problem.options.simulations = 480;
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

/// Equally weighted rows of (push, gain).
Inferred result_of(const std::vector<double>& rows) {
  Inferred result;
  result.found.params = rows;
  result.found.weight.assign(rows.size() / 2, 2.0 / static_cast<double>(rows.size()));
  return result;
}

std::string doubts_of(DriftProblem& drift, const std::vector<double>& rows) {
  drift.problem.names = {"push", "gain"};
  drift.problem.measured = {"position_m"};
  Inferred result = result_of(rows);
  std::string error;
  EXPECT_TRUE(add_doubts(drift.problem, result, error)) << error;
  EXPECT_EQ(result.found.simulations, 40u);
  return join(result.warnings, "\n");
}

// Gains of 20 move the value by 1,200 in a log that moves by a few hundred at most.
TEST(Doubts, TellAPriorThatLeavesTheTruthOut) {
  DriftProblem drift(10);
  drift.config.priors[1] = uniform(20.0, 21.0);
  std::vector<double> rows;
  for (int k = 0; k < 100; ++k) rows.insert(rows.end(), {0.0, 20.0 + 1e-4 * k});
  const std::string told = doubts_of(drift, rows);
  EXPECT_NE(told.find("position_m: the logs lie "), std::string::npos) << told;
  EXPECT_NE(told.find("gain at "), std::string::npos) << told;
}

// The gain acts on nothing where the input is zero: its posterior is its prior.
TEST(Doubts, TellAParameterOfWhichTheLogsSayNothing) {
  DriftProblem drift(11);
  Piece& piece = drift.problem.pieces[0];
  piece.input.setZero();
  piece.measured = DriftProblem::run(piece, (Vector(2) << 0.3, 0.7).finished(), 0.0, 11, drift.step_sd);
  const Coordinates coordinates(drift.config);
  std::vector<double> rows;
  for (std::uint64_t k = 0; k < 400; ++k) {
    double v[2];
    coordinates.draw(k, v);
    rows.insert(rows.end(), {0.3 + 0.01 * v[0], v[1]});
  }
  const std::string told = doubts_of(drift, rows);
  EXPECT_NE(told.find("gain: as wide as its prior"), std::string::npos) << told;
  EXPECT_EQ(told.find("push"), std::string::npos) << told;
  EXPECT_EQ(told.find("the logs lie"), std::string::npos) << told;
}

// Ordinary problems raise no doubt.
TEST(Inference, HasNoDoubtsOfItsOwnModelsLogs) {
  for (const std::uint64_t seed : {12u, 13u, 14u}) {
    DriftProblem drift(seed);
    set_small(drift.problem, "abc_regression");
    Inferred result;
    std::string error;
    ASSERT_TRUE(infer(drift.problem, result, error)) << error;
    EXPECT_TRUE(result.warnings.empty()) << seed << ": " << join(result.warnings);
  }
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
