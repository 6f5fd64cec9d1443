// REPS weights: what the dual promises.
#include "tools/identify/reps.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace tiller::tools {
namespace {

std::vector<double> random_costs(std::size_t n, double scale, double offset, unsigned seed) {
  std::mt19937_64 random(seed);
  std::vector<double> cost(n);
  for (double& c : cost) c = offset + scale * std::pow(static_cast<double>(random() >> 11) * 0x1p-53, 3);
  return cost;
}

double divergence_from_equal(const std::vector<double>& weight) {
  double sum = 0;
  for (const double w : weight)
    if (w > 0) sum += w * std::log(w * static_cast<double>(weight.size()));
  return sum;
}

double total(const std::vector<double>& weight) {
  double sum = 0;
  for (const double w : weight) sum += w;
  return sum;
}

TEST(Reps, DivergenceIsTheBound) {
  for (const double scale : {1e-9, 1.0, 1e9})
    for (const double epsilon : {1e-3, 0.5, 1.0, 4.0}) {
      const std::vector<double> cost = random_costs(500, scale, 3 * scale, 7);
      RepsWeights r;
      ASSERT_TRUE(reps_weights(cost, epsilon, r));
      EXPECT_FALSE(r.slack);
      EXPECT_NEAR(divergence_from_equal(r.weight), epsilon, 1e-6) << scale;
      EXPECT_NEAR(r.kl, epsilon, 1e-6);
      EXPECT_NEAR(total(r.weight), 1.0, 1e-12);
      // the dual is convex, so two higher neighbours make it the minimum
      const double at = reps_dual(cost, epsilon, r.temperature);
      EXPECT_LT(at, reps_dual(cost, epsilon, 1.05 * r.temperature));
      EXPECT_LT(at, reps_dual(cost, epsilon, 0.95 * r.temperature));
    }
}

TEST(Reps, CheaperWeighsMoreAndTheScaleOfCostsDoesNotMatter) {
  const std::vector<double> cost = random_costs(300, 1.0, 0.0, 8), scaled = [&] {
    std::vector<double> c = cost;
    for (double& v : c) v = 1e4 + 1e3 * v;
    return c;
  }();
  RepsWeights a, b;
  ASSERT_TRUE(reps_weights(cost, 1.0, a));
  ASSERT_TRUE(reps_weights(scaled, 1.0, b));
  for (std::size_t i = 0; i < cost.size(); ++i) EXPECT_NEAR(a.weight[i], b.weight[i], 1e-9);
  for (std::size_t i = 0; i < cost.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (cost[i] < cost[j]) {
        EXPECT_GE(a.weight[i], a.weight[j]);
      }
}

TEST(Reps, TemperatureGrowsWithoutBoundAsTheBoundTightens) {
  const std::vector<double> cost = random_costs(200, 1.0, 0.0, 9);
  double last = 0;
  for (const double epsilon : {1.0, 1e-2, 1e-4, 1e-6}) {
    RepsWeights r;
    ASSERT_TRUE(reps_weights(cost, epsilon, r));
    EXPECT_GT(r.temperature, 5 * last) << "KL falls as 1/eta^2, so a hundredth of it takes ten times eta, about";
    last = r.temperature;
  }
}

TEST(Reps, EqualCostsMakeEqualWeights) {
  RepsWeights r;
  ASSERT_TRUE(reps_weights(std::vector<double>(40, 7.5), 1.0, r));
  EXPECT_TRUE(r.slack) << "no weights of a costless choice are away from equal ones";
  for (const double w : r.weight) EXPECT_DOUBLE_EQ(w, 1.0 / 40);
  EXPECT_NEAR(r.kl, 0.0, 1e-15);
}

TEST(Reps, SlackBoundTakesTheCheapest) {
  std::vector<double> cost = random_costs(64, 1.0, 0.0, 10);
  RepsWeights r;
  ASSERT_TRUE(reps_weights(cost, std::log(64.0) + 0.1, r));
  EXPECT_TRUE(r.slack);
  EXPECT_EQ(r.temperature, 0.0);
  EXPECT_NEAR(r.kl, std::log(64.0), 1e-12) << "all the divergence that there is";
  cost[3] = cost[9] = -1;  // two cheapest
  ASSERT_TRUE(reps_weights(cost, std::log(64.0), r));
  EXPECT_DOUBLE_EQ(r.weight[3], 0.5);
  EXPECT_DOUBLE_EQ(r.weight[9], 0.5);
}

TEST(Reps, CostsThatAreNotFiniteDoNotPoison) {
  const std::vector<double> cost = random_costs(100, 1.0, 0.0, 11);
  std::vector<double> with = cost;
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()})
    with.insert(with.begin() + 50, bad);
  RepsWeights a, b;
  ASSERT_TRUE(reps_weights(cost, 1.0, a));
  ASSERT_TRUE(reps_weights(with, 1.0, b));
  EXPECT_EQ(a.temperature, b.temperature);
  for (std::size_t i = 0; i < cost.size(); ++i) EXPECT_EQ(a.weight[i], b.weight[i < 50 ? i : i + 3]);
  for (std::size_t i = 50; i < 53; ++i) EXPECT_EQ(b.weight[i], 0.0);
}

TEST(Reps, RefusesWhatHasNoAnswer) {
  RepsWeights r;
  EXPECT_FALSE(reps_weights({}, 1.0, r));
  EXPECT_FALSE(reps_weights({NAN, INFINITY}, 1.0, r));
  EXPECT_FALSE(reps_weights({1, 2}, 0.0, r));
  EXPECT_FALSE(reps_weights({1, 2}, NAN, r));
}

}  // namespace
}  // namespace tiller::tools
