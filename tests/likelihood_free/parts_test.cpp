// The parts of an inference by themselves: summaries, sequences, the density's training, proposals.

#include "problems.hpp"
#include "tools/likelihood_free/density_net.hpp"
#include "tools/likelihood_free/proposal.hpp"
#include "tools/likelihood_free/sequence.hpp"
#include "tools/likelihood_free/summary.hpp"

namespace tiller::tools {
namespace {

Draws simulated(DriftProblem& drift, std::uint32_t count, DrawMaker& maker) {
  const Proposal prior(drift.config);
  Draws draws;
  std::string error;
  EXPECT_TRUE(maker.simulate(prior.draw(1, 0, count), draws, error)) << error;
  return draws;
}

TEST(Summary, CrossCorrelationsAreThoseOfTheirDefinition) {
  std::vector<Piece> pieces = {{Vector::Constant(1, 1.0), Matrix(1, 3), Matrix(1, 3)}};
  pieces[0].input << 1.0, -1.0, 2.0;
  Matrix y(1, 3);
  y << 2.0, 4.0, 3.0;  // changes 1, 2, -1
  const Vector s = make_summary("cross_correlation", pieces)->of({y});
  ASSERT_EQ(s.size(), 3);
  EXPECT_NEAR(s(0), (1.0 - 2.0 - 2.0) / 3.0, 1e-15);
  EXPECT_NEAR(s(1), 2.0 / 3.0, 1e-15);
  EXPECT_NEAR(s(2), 2.0 - 4.0 / 9.0, 1e-15);
}

// Where the data are linear in the parameters the estimate is the best one: its errors have deviation one, and it
// explains the parameters as least squares do.
TEST(Summary, TheLinearEstimateIsLeastSquares) {
  DriftProblem drift(41);
  const Coordinates coordinates(drift.config);
  DrawMaker maker(drift.problem, coordinates);
  const Draws draws = simulated(drift, 2000, maker);
  auto summary = make_summary("linear", drift.problem.pieces);
  const Matrix s = summary->learn(draws);
  ASSERT_EQ(s.rows(), 4);  // by values and by changes
  // regress the coordinates on the summary: what is left is the posterior's own spread, less than 1.5 times the exact
  Matrix design(s.cols(), 5);
  design << Vector::Ones(s.cols()), s.transpose();
  const Matrix fit = (design.transpose() * design).ldlt().solve(design.transpose() * draws.v.transpose());
  const Matrix left = draws.v.transpose() - design * fit;
  Vector mean;
  Matrix covariance;
  drift.exact(mean, covariance);
  for (int j = 0; j < 2; ++j) {
    const double sd = std::sqrt(left.col(j).squaredNorm() / static_cast<double>(s.cols()));
    EXPECT_LT(sd, 2.2 * std::sqrt(covariance(j, j))) << j;  // values are sums: their errors hang together
    EXPECT_GT(sd, 0.9 * std::sqrt(covariance(j, j))) << j;
  }
}

// Learnt once more without a draw, by the same code; V and L of all the draws differ by one in 300.
TEST(Summary, ADrawsOwnEstimateIsThatOfTheOthers) {
  DriftProblem drift(44, 30);
  const Coordinates coordinates(drift.config);
  DrawMaker maker(drift.problem, coordinates);
  const Draws draws = simulated(drift, 300, maker);
  auto summary = make_summary("linear", drift.problem.pieces);
  const Matrix left_out = summary->learn(draws);
  const Matrix spread = left_out.colwise() - left_out.rowwise().mean();
  for (const Eigen::Index k : {0, 7, 299}) {
    std::vector<Eigen::Index> others;
    for (Eigen::Index i = 0; i < draws.count(); ++i)
      if (i != k) others.push_back(i);
    auto without = make_summary("linear", drift.problem.pieces);
    without->learn(draws.at(others));
    const Vector wanted = without->of(draws.trajectory[static_cast<std::size_t>(k)]);
    for (Eigen::Index i = 0; i < wanted.size(); ++i)
      EXPECT_NEAR(left_out(i, k), wanted(i), 0.05 * spread.row(i).norm() / std::sqrt(300.0)) << i << ", draw " << k;
  }
}

// Values that no parameter moves, and more of them than draws: chance slopes tell a draw's own parameters from its own
// values, and nobody else's. Of draws that it knows, of() correlates by 4 / sqrt(16 + 4) = .89 (four values a draw);
// 4 / sqrt(n) is four deviations of no correlation.
TEST(Summary, FindsNothingWhereThereIsNothing) {
  DriftProblem drift(45);
  const Eigen::Index n = 150, values = 600;
  Draws draws{Matrix(1, n), {}};
  Rng rng(45, 202, 0);
  for (Eigen::Index k = 0; k < n; ++k) {
    draws.v(0, k) = rng.normal();
    Matrix y(1, values);
    for (Eigen::Index i = 0; i < values; ++i) y(0, i) = rng.normal();
    draws.trajectory.push_back({y});
  }
  drift.problem.pieces[0] = {Vector::Zero(1), Matrix::Zero(1, values), Matrix::Zero(1, values)};
  auto summary = make_summary("linear", drift.problem.pieces);
  const auto correlation = [&](const Vector& s) {
    const Vector a = s.array() - s.mean(), b = draws.v.row(0).transpose().array() - draws.v.mean();
    return a.dot(b) / (a.norm() * b.norm());
  };
  EXPECT_LT(std::fabs(correlation(summary->learn(draws).row(0))), 4.0 / std::sqrt(static_cast<double>(n)));
  EXPECT_GT(correlation(summary->of(draws.trajectory).row(0)), 0.7);
}

TEST(Sequencer, StandardisesBlockByBlockOverTheDraws) {
  DriftProblem drift(42, 120);
  const Coordinates coordinates(drift.config);
  DrawMaker maker(drift.problem, coordinates);
  const Draws draws = simulated(drift, 300, maker);
  Sequencer sequencer(drift.problem.pieces);
  sequencer.learn(draws.trajectory);
  const std::vector<Matrix> sequence = sequencer.of(draws.trajectory);
  ASSERT_EQ(sequence.size(), static_cast<std::size_t>(Sequencer::kLongest));
  ASSERT_EQ(sequence[0].rows(), 3);
  for (const Matrix& step : sequence)
    for (int i = 0; i < 2; ++i) {
      EXPECT_NEAR(step.row(i).mean(), 0.0, 1e-9);
      EXPECT_NEAR(step.row(i).squaredNorm() / 300.0, 1.0, 1e-9);
    }
  EXPECT_EQ(sequence[3](2, 0), sequence[3](2, 17));  // the input is the same for all
}

// The sequence alone: the density must be nearer to the exact posterior's entropy than what a network without memory
// has.
TEST(DensityNet, LearnsThroughARecurrentUnit) {
  DriftProblem drift(43);
  const Coordinates coordinates(drift.config);
  DrawMaker maker(drift.problem, coordinates);
  const Draws draws = simulated(drift, 1500, maker);
  Sequencer sequencer(drift.problem.pieces);
  sequencer.learn(draws.trajectory);
  DensityNetOptions how;
  how.components = 1;
  how.hidden = 24;
  how.states = 8;
  how.epochs = 25;
  how.rate = 1e-2;
  DensityNet net;
  const Features features{{}, sequencer.of(draws.trajectory)};
  net.train(features, draws.v, how);
  // the prior's own entropy: 1/2 log((2 pi e)^2 1 4) = 3.53 nats; with a tenth of the deviation each, 4.6 less
  EXPECT_LT(net.loss(features, draws.v), 3.53 - 3.0);
}

TEST(DensityNet, KnowsADensityThatDependsOnItsFeatures) {
  // v = x + (0.1 + 0.4 |x|) e: a normal whose width the feature decides
  constexpr int kSamples = 3000;
  Matrix x(1, kSamples), v(1, kSamples);
  Rng rng(1, 202, 0);
  for (int k = 0; k < kSamples; ++k) {
    x(0, k) = 2.0 * rng.uniform() - 1.0;
    v(0, k) = x(0, k) + (0.1 + 0.4 * std::fabs(x(0, k))) * rng.normal();
  }
  DensityNetOptions how;
  how.components = 1;
  DensityNet net;
  net.train({x, {}}, v, how);
  for (const double at : {-0.8, 0.0, 0.5}) {
    const nets::NormalMixture q = net.at({Matrix::Constant(1, 1, at), {}});
    EXPECT_NEAR(q.mean(0, 0), at, 0.08) << at;
    EXPECT_NEAR(std::sqrt(q.covariance[0](0, 0)), 0.1 + 0.4 * std::fabs(at), 0.06) << at;
  }
}

TEST(Proposal, IsWiderThanWhatItWasFittedToAndCoversNoMore) {
  DriftProblem drift(44);
  Proposal proposal(drift.config);
  Matrix v(2, 400);
  Rng rng(2, 203, 0);
  for (int k = 0; k < 400; ++k) v.col(k) << 0.3 + 0.1 * rng.normal(), -1.0 + 0.2 * rng.normal();
  proposal.fit(v, Vector::Ones(400), 2.0);
  const Matrix drawn = proposal.draw(1, 1, 4000);
  const Vector mean = drawn.rowwise().mean();
  EXPECT_NEAR(mean(0), 0.3, 0.03);
  EXPECT_NEAR(std::sqrt((drawn.row(0).array() - mean(0)).square().mean()), 0.2, 0.03);
  const double inside[2] = {0.3, -1.0}, far[2] = {2.0, -1.0};
  EXPECT_TRUE(std::isfinite(proposal.log_density(inside)));
  EXPECT_EQ(proposal.log_density(far), -kInfinity);
  EXPECT_TRUE(std::isfinite(proposal.log_prior(far)));
}

}  // namespace
}  // namespace tiller::tools
