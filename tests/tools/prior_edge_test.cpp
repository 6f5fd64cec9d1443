// A posterior on the edge of its prior is named, and one that is near a bound by right is not.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/rng.hpp"
#include "posterior/prior.hpp"
#include "robot_text.hpp"
#include "tiller/config.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/prior_edge.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

constexpr tiller_prior_t kMass = {tiller_prior_uniform, 0, 0, 0, 0.05, 0.15};
constexpr PhysicalRange kNotNegative = {0, INFINITY};

/// Draws of the posterior under a uniform prior and a normal likelihood: a normal cut to the prior's bounds.
std::vector<double> posterior(const tiller_prior_t& prior, double optimum, double sd, int count = 256) {
  const tiller_prior_t cut = {tiller_prior_normal, 0, optimum, sd, prior.low, prior.high};
  std::vector<double> values;
  for (int k = 0; k < count; ++k) values.push_back(prior_quantile(cut, (k + 0.5) / count));
  return values;
}

std::string text_of(const tiller_prior_t& prior, const std::vector<double>& values,
                    const PhysicalRange& physical = kNotNegative) {
  return edge_text("mass_kg", find_prior_edge(prior, physical, values, {}));
}

TEST(PriorEdge, ATruthOutsideOfTheBoundsIsNamedWithTheBound) {
  EXPECT_EQ(text_of(kMass, posterior(kMass, 0.16, 0.002)), "mass_kg at its upper bound 0.15: widen the prior");
  EXPECT_EQ(text_of(kMass, posterior(kMass, 0.02, 0.01)), "mass_kg at its lower bound 0.05: widen the prior");
}

TEST(PriorEdge, APosteriorThatIsWideOrInsideIsNot) {
  for (const double optimum : {0.05, 0.06, 0.1, 0.145, 0.149, 0.15})
    EXPECT_EQ(text_of(kMass, posterior(kMass, optimum, 0.02)), "") << "wide, optimum " << optimum;
  for (const double optimum : {0.1, 0.145, 0.149, 0.1496})
    EXPECT_EQ(text_of(kMass, posterior(kMass, optimum, 0.0003)), "") << "sharp, optimum " << optimum;
  EXPECT_EQ(text_of(kMass, posterior(kMass, 0.1, 10)), "") << "nothing was learnt: the prior itself";
}

/// Of `count` experiments with a true value and measurements of it, how many end with an edge that is named; each has
/// the optimum that its noise gives it, and 128 draws by chance.
int named(double truth, double sd, int count) {
  int named = 0;
  for (int k = 0; k < count; ++k) {
    Rng rng(17, 3, static_cast<std::uint64_t>(k));
    const tiller_prior_t cut = {tiller_prior_normal, 0, truth + sd * rng.normal(), sd, kMass.low, kMass.high};
    std::vector<double> values;
    for (int i = 0; i < 128; ++i) values.push_back(prior_quantile(cut, rng.uniform()));
    named += find_prior_edge(kMass, kNotNegative, values, {}).side != EdgeSide::none;
  }
  return named;
}

TEST(PriorEdge, ItIsSeldomNamedFalselyAndSeldomMissed) {
  // a truth inside by a tenth of the range, known to a tenth and to a thousandth of it
  EXPECT_LE(named(0.14, 0.01, 200), 10);
  EXPECT_EQ(named(0.14, 0.0001, 200), 0);
  EXPECT_EQ(named(0.149, 0.0001, 200), 0) << "inside by a hundredth of the range is inside, where the data know it";
  // outside by a tenth of the range: the noise puts few of the optima back inside
  EXPECT_GE(named(0.16, 0.003, 200), 180);
  EXPECT_GE(named(0.16, 0.0001, 200), 180);
}

TEST(PriorEdge, WeightsCount) {
  std::vector<double> values = posterior(kMass, 0.16, 0.002, 64), weight(64, 1.0);
  for (int k = 0; k < 64; ++k) {
    values.push_back(0.08);
    weight.push_back(100.0);
  }
  EXPECT_EQ(find_prior_edge(kMass, kNotNegative, values, weight).side, EdgeSide::none);
  for (std::size_t k = 64; k < 128; ++k) weight[k] = 0.0;
  EXPECT_EQ(find_prior_edge(kMass, kNotNegative, values, weight).side, EdgeSide::high);
}

TEST(PriorEdge, ALogNormalPriorHasTailsAndMayHaveABound) {
  const tiller_prior_t open = {tiller_prior_log_normal, 0, 0.1, 0.2, 0, INFINITY};
  // 99.5 % of it lie below 0.1 exp(2.5758 * 0.2) = 0.1674
  EXPECT_EQ(text_of(open, std::vector<double>(64, 0.17)),
            "mass_kg above 0.1674, beyond 99.5 % of its prior: widen the prior");
  EXPECT_EQ(text_of(open, std::vector<double>(64, 0.055)),
            "mass_kg below 0.05974, beyond 99.5 % of its prior: widen the prior");
  EXPECT_EQ(text_of(open, std::vector<double>(64, 0.16)), "");
  const tiller_prior_t cut = {tiller_prior_log_normal, 0, 0.1, 0.2, 0, 0.12};
  EXPECT_EQ(text_of(cut, posterior(cut, 0.13, 0.001)), "mass_kg at its upper bound 0.12: widen the prior");
  EXPECT_EQ(text_of(cut, posterior(cut, 0.118, 0.001)), "");
}

TEST(PriorEdge, ANormalPriorToo) {
  const tiller_prior_t normal = {tiller_prior_normal, 0, 0.1, 0.01, -INFINITY, INFINITY};
  EXPECT_EQ(text_of(normal, posterior(normal, 0.135, 0.001)),
            "mass_kg above 0.1258, beyond 99.5 % of its prior: widen the prior");
  EXPECT_EQ(text_of(normal, posterior(normal, 0.12, 0.001)), "");
  const tiller_prior_t far_cut = {tiller_prior_normal, 0, 0.1, 0.01, 0.05, INFINITY};  // five deviations away
  EXPECT_EQ(text_of(far_cut, posterior(far_cut, 0.06, 0.004)),
            "mass_kg below 0.07424, beyond 99.5 % of its prior: widen the prior");
  EXPECT_EQ(text_of(far_cut, posterior(far_cut, 0.02, 0.002)), "mass_kg at its lower bound 0.05: widen the prior");
}

TEST(PriorEdge, AtABoundOfPhysicsThereIsNothingToWiden) {
  const tiller_prior_t friction = {tiller_prior_uniform, 0, 0, 0, 0, 0.3};
  const std::vector<double> none = posterior(friction, -0.01, 0.004);
  EXPECT_EQ(text_of(friction, none), "mass_kg at 0, its bound by physics: the data show none of it");
  EXPECT_EQ(text_of(friction, none, {-INFINITY, INFINITY}), "mass_kg at its lower bound 0: widen the prior");
  const tiller_prior_t gain = {tiller_prior_uniform, 0, 0, 0, -1, 1};
  EXPECT_EQ(text_of(gain, posterior(gain, -1.1, 0.01), {-1, INFINITY}), "mass_kg at -1, its bound by physics");
  EXPECT_EQ(text_of(gain, posterior(gain, 1.1, 0.01), {-1, INFINITY}), "mass_kg at its upper bound 1: widen the prior");
}

TEST(PriorEdge, WhatPhysicsAllowsIsTheCataloguesAndTheUnits) {
  std::string errors;
  const auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  tiller::Config config = robot->config;
  const auto least = [&](const char* name) {
    return physical_range(config, robot->names.params, static_cast<std::uint32_t>(index_of(robot->names.params, name)))
        .least;
  };
  EXPECT_EQ(least("pole_mass_kg"), 0.0);
  EXPECT_EQ(least("half_length_m"), 0.0);
  EXPECT_EQ(least("cart.damping_SI"), 0.0);
  config.model = tiller_find_model("pendulum");
  const Words names = {"mass_kg", "length_m", "damping_Nms"};
  config.priors[2] = {tiller_prior_uniform, 0, 0, 0, 0.1, 0.3};
  EXPECT_EQ(physical_range(config, names, 2).least, -INFINITY) << "a model does not say that it is a friction";
  config.priors[2].low = 0;
  EXPECT_EQ(physical_range(config, names, 2).least, 0.0) << "its prior does";
}

TEST(PriorEdge, OfAConfigurationAreItsFreeParameters) {
  std::string errors;
  const auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const std::size_t np = robot->names.params.size();
  Particles particles;
  const std::vector<double> mass = posterior(kMass, 0.17, 0.002, 128);
  for (const double value : mass) {
    std::vector<double> row(np, 0.5);  // of the half length the prior's mean; the effects' are not looked at here
    row[0] = 1.0;
    row[1] = value;
    particles.params.insert(particles.params.end(), row.begin(), row.end());
  }
  const std::vector<PriorEdge> edges = find_prior_edges(robot->config, robot->names.params, particles);
  ASSERT_EQ(edges.size(), np);
  EXPECT_EQ(edges[0].side, EdgeSide::none) << "fixed";
  EXPECT_EQ(edges[2].side, EdgeSide::none);
  EXPECT_EQ(edge_json(robot->names.params[1], edges[1]).dump(),
            R"({"at":"upper bound","by":"prior",)"
            R"("text":"pole_mass_kg at its upper bound 0.15: widen the prior","value":0.15})");
  EXPECT_TRUE(edge_json(robot->names.params[2], edges[2]).is_null());
}

TEST(PriorEdge, WithAJointPriorTheBoundsStayAndTheTailsAreNotLookedAt) {
  std::string errors;
  const auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  Particles particles;
  for (const double value : posterior(kMass, 0.17, 0.002, 64)) {
    std::vector<double> row(robot->names.params.size(), 0.5);
    row[1] = value;
    row[2] = 0.9;  // four deviations from the robot file's 0.5 +- 0.1
    particles.params.insert(particles.params.end(), row.begin(), row.end());
  }
  EXPECT_EQ(find_prior_edges(robot->config, robot->names.params, particles)[2].side, EdgeSide::high);
  const JointPrior carried(3, {1.0}, {0.1, 0.9, -0.7}, {0.01, 0, 0, 0.02, 0.03, 0, 0, 0, 0.4});  // learnt before
  robot->config.prior_mixture = &carried.mixture;
  const std::vector<PriorEdge> edges = find_prior_edges(robot->config, robot->names.params, particles);
  EXPECT_EQ(edges[1].side, EdgeSide::high) << "the robot file's bound";
  EXPECT_EQ(edges[2].side, EdgeSide::none) << "the earlier episode's posterior is there, too";
}

}  // namespace
}  // namespace tiller::tools
