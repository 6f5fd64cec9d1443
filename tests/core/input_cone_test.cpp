#include "core/input_cone.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

// Properties of the projection onto cones over random limits, rates, cones and commands, NaN among them. The oracle is
// written from the inequality, in long double.

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kEps = std::numeric_limits<double>::epsilon();
using Inputs = std::vector<double>;

/// Limits and cones as tiller_config_check lets them through: axes last, so that they stand in no norm.
struct Problem {
  std::uint32_t inputs = 0;
  Inputs low, high, step;
  InputCones cones;

  explicit Problem(std::mt19937_64& random) {
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    const double unit = std::pow(10.0, 8.0 * uniform(random) - 4.0);
    const std::uint32_t norms = 1 + below(5), axes = below(3);
    inputs = norms + axes;
    for (std::uint32_t i = 0; i < inputs; ++i) {
      low.push_back(i < norms ? -unit * uniform(random) : unit * (uniform(random) - 0.3));
      high.push_back(i < norms ? unit * uniform(random) : low[i] + unit * uniform(random));
      step.push_back(below(3) == 0 ? kInf : 0.3 * unit * uniform(random) * (below(8) == 0 ? 1e-6 : 1.0));
    }
    tiller_input_cone_t cone[TILLER_MAX_INPUT_CONES];
    const std::uint32_t count = 1 + below(TILLER_MAX_INPUT_CONES);
    for (std::uint32_t c = 0; c < count; ++c) {
      cone[c] = {};
      while (cone[c].inputs == 0)
        for (std::uint32_t i = 0; i < norms; ++i) cone[c].inputs |= below(2) << i;
      cone[c].limit = unit * uniform(random);
      if (axes == 0 || below(2) == 0) continue;
      cone[c].axis = norms + below(axes);
      cone[c].slope = 2.0 * uniform(random);
      // the radius at the axis' low end: 0 in every other cone
      const double least = cone[c].slope * low[cone[c].axis];
      cone[c].limit = std::max(0.0, std::nextafter(-least, kInf)) + (below(2) == 0 ? 0.0 : cone[c].limit);
    }
    cones = make_input_cones(cone, count);
  }

  /// Every input by itself; what stands before the cones wherever commands are limited.
  Inputs limited(const Inputs& wanted, const Inputs& last) const {
    Inputs u(inputs);
    for (std::uint32_t i = 0; i < inputs; ++i)
      u[i] = std::clamp(std::clamp(wanted[i], low[i], high[i]), std::max(low[i], last[i] - step[i]),
                        std::min(high[i], last[i] + step[i]));
    return u;
  }
  Inputs kept(const Inputs& wanted, const Inputs& last) const {
    Inputs u = limited(wanted, last);
    keep_cones(cones, inputs, last.data(), step.data(), u.data());
    return u;
  }
  Inputs draw(std::mt19937_64& random) const {
    std::uniform_real_distribution<double> wide(-0.5, 1.5);
    Inputs u(inputs);
    for (std::uint32_t i = 0; i < inputs; ++i) u[i] = low[i] + wide(random) * (high[i] - low[i]);
    return u;
  }
  /// Within limits and cones.
  Inputs start(std::mt19937_64& random) const {
    Inputs u = draw(random);
    for (std::uint32_t i = 0; i < inputs; ++i) u[i] = std::clamp(u[i], low[i], high[i]);
    shrink_to_cones(cones, u.data());
    return u;
  }
  /// What a cone's inequality lacks, in units of the last place of what it is made of. 2^-53 for each square, sum, the
  /// root and the radius' product and sum: n + 3 of the norm, 2 of limit + slope |u_axis|; all below 8.
  double excess_ulps(const Inputs& u) const {
    double worst = -kInf;
    for (std::uint32_t c = 0; c < cones.count; ++c) {
      const tiller_input_cone_t& cone = cones.cone[c];
      long double squares = 0.0L, radius = cone.limit, size = cone.limit;
      for (std::uint32_t i = 0; i < inputs; ++i)
        if ((cone.inputs >> i) & 1u) squares += static_cast<long double>(u[i]) * u[i];
      if (cone.slope > 0.0) {
        radius += static_cast<long double>(cone.slope) * u[cone.axis];
        size += std::fabs(static_cast<long double>(cone.slope) * u[cone.axis]);
      }
      const long double unit = kEps * std::max<long double>(size, std::numeric_limits<double>::min());
      worst = std::max(worst, static_cast<double>((std::sqrt(squares) - radius) / unit));
    }
    return worst;
  }
};

TEST(InputCone, NothingIsEverOutsideLimitsRatesAndCones) {
  std::mt19937_64 random(5);
  double worst = -kInf;
  int shrunk = 0, short_ways = 0, problems = 0;
  for (; problems < 4000; ++problems) {
    const Problem p(random);
    Inputs last = p.start(random);
    ASSERT_TRUE(within_cones(p.cones, last.data()));
    for (int k = 0; k < 50; ++k) {
      const Inputs wanted = p.draw(random), u = p.kept(wanted, last), alone = p.limited(wanted, last);
      Inputs onto = alone;
      shrink_to_cones(p.cones, onto.data());
      shrunk += onto != alone;
      short_ways += u != onto;
      EXPECT_TRUE(within_cones(p.cones, u.data())) << problems << " " << k;
      worst = std::max(worst, p.excess_ulps(u));
      for (std::uint32_t i = 0; i < p.inputs; ++i) {
        EXPECT_GE(u[i], p.low[i]);
        EXPECT_LE(u[i], p.high[i]);
        // the limits' own sum last +- step is rounded, for an input that no cone ties to another
        EXPECT_LE(std::fabs(u[i] - last[i]), p.step[i] + kEps * (std::fabs(u[i]) + std::fabs(last[i])));
      }
      last = u;
    }
  }
  std::printf("%d commands: %d shrunk, %d kept short by a rate; largest excess %.2f units of the last place\n",
              50 * problems, shrunk, short_ways, worst);
  EXPECT_LE(worst, 8.0);
  EXPECT_GT(shrunk, 20000) << "the commands were too tame to test anything";
  EXPECT_GT(short_ways, 5000) << "the rates were too tame to test anything";
}

TEST(InputCone, ProjectingTwiceIsProjectingOnce) {
  std::mt19937_64 random(6);
  for (int problem = 0; problem < 4000; ++problem) {
    const Problem p(random);
    const Inputs last = p.start(random);
    const Inputs once = p.kept(p.draw(random), last), twice = p.kept(once, last);
    EXPECT_EQ(once, twice) << problem;
    Inputs shrunk = p.start(random), again = shrunk;
    shrink_to_cones(p.cones, again.data());
    EXPECT_EQ(shrunk, again) << "what is within stays to the last bit";
  }
}

/// Halving the distance of two commands until it is nothing: their projections come together as well.
TEST(InputCone, IsContinuous) {
  std::mt19937_64 random(7);
  double steepest = 0.0;
  for (int problem = 0; problem < 4000; ++problem) {
    Problem p(random);
    double range = 0.0;
    for (std::uint32_t i = 0; i < p.inputs; ++i) range = std::max(range, p.high[i] - p.low[i]);
    // the share of the way goes with step / change: its slope is as steep as a step is small
    for (double& step : p.step) step = std::max(step, 0.01 * range);
    const Inputs last = p.start(random);
    Inputs a = p.draw(random), b = p.draw(random);
    const auto distance = [&](const Inputs& x, const Inputs& y) {
      double most = 0.0;
      for (std::uint32_t i = 0; i < p.inputs; ++i) most = std::max(most, std::fabs(x[i] - y[i]) / range);
      return most;
    };
    // towards the larger jump of the two halves: if there is a step anywhere, the search ends at one
    for (int halving = 0; halving < 40; ++halving) {
      Inputs middle(p.inputs);
      for (std::uint32_t i = 0; i < p.inputs; ++i) middle[i] = 0.5 * (a[i] + b[i]);
      const Inputs at = p.kept(middle, last);
      if (distance(p.kept(a, last), at) >= distance(at, p.kept(b, last)))
        b = middle;
      else
        a = middle;
    }
    const double apart = distance(a, b), jump = distance(p.kept(a, last), p.kept(b, last));
    steepest = std::max(steepest, jump);
    EXPECT_LT(apart, 1e-11);
  }
  // 2^-40 of the range, times slopes of up to 100 for the share, and a few for the cones' slopes and the radial cut
  std::printf("largest jump between commands that are 1e-12 of their range apart: %.1e of a range\n", steepest);
  EXPECT_LT(steepest, 1e-9);
}

TEST(InputCone, ShrinksRadiallyForTheValueOfTheAxis) {
  const tiller_input_cone_t friction = {0b011, 2, 0.5, 0.0};
  const InputCones cones = make_input_cones(&friction, 1);
  double u[] = {3.0, -4.0, 4.0};
  shrink_to_cones(cones, u);
  EXPECT_NEAR(u[0], 1.2, 1e-15);
  EXPECT_NEAR(u[1], -1.6, 1e-15);
  EXPECT_EQ(u[2], 4.0);
  double apex[] = {3.0, -4.0, 0.0};
  shrink_to_cones(cones, apex);
  EXPECT_EQ(apex[0], 0.0);
  EXPECT_EQ(apex[1], 0.0);
}

/// A pull that has to go down faster than the tangential force may follow: the pull waits.
TEST(InputCone, AnAxisWaitsForTheRatesOfTheNorm) {
  const tiller_input_cone_t friction = {0b01, 1, 1.0, 0.0};
  const InputCones cones = make_input_cones(&friction, 1);
  const double last[] = {2.0, 2.0}, step[] = {0.5, kInf};
  double u[] = {2.0, 0.0};
  keep_cones(cones, 2, last, step, u);
  EXPECT_NEAR(u[0], 1.5, 1e-14);
  EXPECT_NEAR(u[1], 1.5, 1e-14);
  EXPECT_TRUE(within_cones(cones, u));
}

/// From outside its cone an input still comes no faster than its rate allows, and not back past what was asked.
TEST(InputCone, FromOutsideTheRatesHoldAllTheSame) {
  const tiller_input_cone_t norm = {0b11, 0, 0.0, 1.0};
  const InputCones cones = make_input_cones(&norm, 1);
  const double last[] = {3.0, 4.0}, step[] = {0.5, 0.5};
  double u[] = {0.0, 0.0};
  keep_cones(cones, 2, last, step, u);
  EXPECT_FALSE(within_cones(cones, u));
  EXPECT_NEAR(u[0], 3.0 - 0.375, 1e-14) << "both inputs go the same share of their way";
  EXPECT_NEAR(u[1], 4.0 - 0.5, 1e-14);
}

TEST(InputCone, ConesThatShareAnInputAreOneGroup) {
  const tiller_input_cone_t cone[] = {{0b000011, 2, 0.5, 0.0}, {0b110000, 0, 0.0, 1.0}, {0b001010, 0, 0.0, 1.0}};
  const InputCones cones = make_input_cones(cone, 3);
  ASSERT_EQ(cones.group_count, 2u);
  EXPECT_EQ(cones.group[0] | cones.group[1], 0b111111u);
  EXPECT_EQ(cones.group[0] & cones.group[1], 0u);
  EXPECT_TRUE(cones.group[0] == 0b110000u || cones.group[1] == 0b110000u);
}

TEST(InputCone, ANumberThatIsNoneStaysNone) {
  const tiller_input_cone_t norm = {0b11, 0, 0.0, 1.0};
  const InputCones cones = make_input_cones(&norm, 1);
  double u[] = {std::nan(""), 0.5};
  shrink_to_cones(cones, u);
  EXPECT_TRUE(std::isnan(u[0]));
  EXPECT_FALSE(within_cones(cones, u));
}

}  // namespace
}  // namespace tiller
