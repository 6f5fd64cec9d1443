// Games whose values are known, the linear program below them, and occupancies.

#include "tools/imitate/game.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tools/imitate/finite_process.hpp"

namespace tiller::tools::imitate {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A process of one state and so many actions: its occupancies are the shares of the actions.
Game bandit(const VectorXd& demonstrated, const std::vector<VectorXd>& arms) {
  Game game;
  game.demonstrated = demonstrated;
  game.best = [arms](const VectorXd& w) {
    std::size_t best = 0;
    for (std::size_t j = 1; j < arms.size(); ++j)
      if (w.dot(arms[j]) < w.dot(arms[best]) - 1e-12) best = j;
    return arms[best];
  };
  return game;
}

VectorXd vector(std::initializer_list<double> values) {
  VectorXd v(static_cast<Eigen::Index>(values.size()));
  Eigen::Index i = 0;
  for (const double x : values) v(i++) = x;
  return v;
}

/// Actions that slip: action i is done with 1 - slip, the other one else.
std::vector<VectorXd> slipping(double slip) { return {vector({1 - slip, slip}), vector({slip, 1 - slip})}; }

TEST(TotalVariation, OfTwoActionsThatSlipIsTheSlip) {
  for (const double slip : {0.01, 0.2, 0.45}) {
    const Equilibrium e = total_variation(bandit(vector({1, 0}), slipping(slip)), 1e-12, 50);
    EXPECT_NEAR(e.value, slip, 1e-9);  // the goal is 1e-6
    EXPECT_NEAR(e.bound, slip, 1e-9);
  }
}

TEST(TotalVariation, OfWhatAMixtureMakesIsZero) {
  const Equilibrium e = total_variation(bandit(vector({0.3, 0.7}), slipping(0.1)), 1e-12, 50);
  EXPECT_NEAR(e.value, 0, 1e-9);
  EXPECT_NEAR(e.share[0] + e.share.back(), 1, 1e-9);
}

TEST(Projection, FindsTheNearestPointOfATriangle) {
  // the demonstrator's (0, 0) is 1 / sqrt 2 from the edge between (1, 0) and (0, 1)
  const auto game = bandit(vector({0, 0}), {vector({1, 0}), vector({0, 1}), vector({2, 2})});
  const Equilibrium e = projection(game, 1e-9, 500);
  EXPECT_NEAR(e.value, std::sqrt(0.5), 1e-6);
  EXPECT_LE(e.bound, e.value + 1e-9);
}

TEST(MultiplicativeWeights, BoundsTheValueFromBothSides) {
  // matching pennies about (1, 1): the value of rows (2, 1) and (1, 2) is half above
  const auto game = bandit(vector({1, 1}), {vector({2, 1}), vector({1, 2})});
  const Equilibrium e = multiplicative_weights(game, VectorXd::Ones(2), 2000);
  EXPECT_GE(e.value, 0.5 - 1e-9);
  EXPECT_LE(e.bound, 0.5 + 1e-9);
  EXPECT_LT(e.value - e.bound, 0.05);  // sqrt(2 log 2 / 2000) = 0.026, and the last round's
}

TEST(LinearProgram, SolvesATextbookCase) {
  // most 3 x + 5 y so that x <= 4, 2 y <= 12, 3 x + 2 y <= 18: 36 at (2, 6) (Hillier and Lieberman)
  MatrixXd a(3, 5);
  a << 1, 0, 1, 0, 0, 0, 2, 0, 1, 0, 3, 2, 0, 0, 1;
  std::vector<int> basis = {2, 3, 4};
  VectorXd x, dual;
  ASSERT_TRUE(linear_program(a, vector({4, 12, 18}), vector({-3, -5, 0, 0, 0}), basis, x, dual));
  EXPECT_NEAR(x(0), 2, 1e-12);
  EXPECT_NEAR(x(1), 6, 1e-12);
  EXPECT_NEAR(dual(2), -1, 1e-12);  // the price of the third row
  std::vector<int> one = {0};       // x - y = 1 for the largest x has no end
  EXPECT_FALSE(linear_program((MatrixXd(1, 2) << 1, -1).finished(), vector({1}), vector({-1, 0}), one, x, dual));
}

TEST(FiniteProcess, OccupancySumsToOneAndObeysTheFlow) {
  FiniteProcess p;
  p.start = vector({0.2, 0.8});
  p.discount = 0.7;
  p.next.assign(2, MatrixXd(2, 2));
  p.next[0] << 0.9, 0.1, 0.4, 0.6;
  p.next[1] << 0.2, 0.8, 0.5, 0.5;
  const MatrixXd policy = (MatrixXd(2, 2) << 0.3, 0.7, 1, 0).finished();
  const VectorXd o = p.occupancy(policy);
  EXPECT_NEAR(o.sum(), 1, 1e-12);
  // the same by following the chain for long
  VectorXd visits = VectorXd::Zero(2), now = p.start;
  MatrixXd chain(2, 2);
  for (int s = 0; s < 2; ++s) chain.row(s) = policy(s, 0) * p.next[0].row(s) + policy(s, 1) * p.next[1].row(s);
  for (int t = 0; t < 300; ++t, now = chain.transpose() * now) visits += 0.3 * std::pow(0.7, t) * now;
  EXPECT_NEAR(o(0) + o(1), visits(0), 1e-12);
}

TEST(FiniteProcess, TheBestPolicyIsTheBestOfAll) {
  FiniteProcess p;
  p.start = vector({1, 0});
  p.next.assign(2, MatrixXd(2, 2));
  p.next[0] << 0.9, 0.1, 0.4, 0.6;
  p.next[1] << 0.2, 0.8, 0.5, 0.5;
  const VectorXd cost = vector({1.0, 1.3, 0.2, 0.6});
  double least = 1e9;
  for (int code = 0; code < 4; ++code) {
    MatrixXd policy = MatrixXd::Zero(2, 2);
    policy(0, code & 1) = policy(1, code >> 1) = 1;
    least = std::min(least, cost.dot(p.occupancy(policy)));
  }
  EXPECT_NEAR(cost.dot(p.best_occupancy(cost)), least, 1e-12);
}

}  // namespace
}  // namespace tiller::tools::imitate
