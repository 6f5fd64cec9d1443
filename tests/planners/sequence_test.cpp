// Knots, their clock and the limits of a command, against definitions.

#include "planners/sequence.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

namespace tiller_test {
namespace {

using tiller::InputLimit;
using tiller::KnotClock;

struct Sequence {
  KnotClock clock;
  std::vector<std::uint32_t> first_step;
  std::vector<float> fraction;
  std::vector<double> knots;
  bool cubic = false;
  double before = 0.0;

  Sequence(std::uint32_t horizon, std::uint32_t count)
      : clock{horizon, count, 0}, first_step(count), fraction(horizon) {
    tiller::fill_grid(clock, first_step.data(), fraction.data());
  }
  void advance(std::uint32_t periods) {
    const std::uint32_t gone = tiller::advance_clock(clock, periods);
    if (gone > 0) before = knots[std::min(gone, clock.knots) - 1];
    tiller::shift_knots(knots.data(), clock.knots, gone);
    tiller::fill_grid(clock, first_step.data(), fraction.data());
  }
  std::vector<float> inputs(const InputLimit& limit, double start) const {
    std::vector<float> all(clock.horizon);
    tiller::expand_sequence({clock.horizon, 1, clock.knots, first_step.data(), fraction.data()}, &limit, {},
                            knots.data(), &start, all.data(), nullptr, cubic ? &before : nullptr);
    return all;
  }
};

constexpr std::uint32_t kCubic = 1024;  // beside the number of knots
constexpr InputLimit kFree = {-1e6, 1e6, std::numeric_limits<double>::infinity()};

TEST(Sequence, interpolates_from_the_first_step_to_the_last) {
  Sequence s(11, 3);
  s.knots = {0.0, 5.0, -5.0};
  const std::vector<float> u = s.inputs(kFree, 0.0);
  for (int t = 0; t < 11; ++t)
    EXPECT_FLOAT_EQ(u[t], t <= 5 ? static_cast<float>(t) : 15.0f - 2.0f * static_cast<float>(t));
}

TEST(Sequence, shifts_exactly_whatever_the_spacing) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-10.0, 10.0);
  for (const std::uint32_t horizon : {2u, 3u, 17u, 50u, 512u})
    for (const std::uint32_t count : {2u, 3u, 6u, 13u, 64u, 2u | kCubic, 3u | kCubic, 6u | kCubic, 64u | kCubic}) {
      Sequence s(horizon, count & ~kCubic);
      s.cubic = (count & kCubic) != 0;
      for (std::uint32_t j = 0; j < s.clock.knots; ++j) s.knots.push_back(uniform(random));
      const std::vector<float> old = s.inputs(kFree, 0.0);
      for (std::uint32_t gone = 1; gone < horizon + 3; ++gone) {
        s.advance(1);
        const std::vector<float> now = s.inputs(kFree, 0.0);
        for (std::uint32_t t = 0; t < horizon; ++t) {
          const std::uint32_t then = t + gone < horizon ? t + gone : horizon - 1;
          // fractions are floats; where knots stand closer than steps, a slope of 20 a fraction of a step away
          // (a cubic's is three times the secant's at most)
          ASSERT_NEAR(now[t], old[then], 3e-5) << horizon << " steps, " << count << " knots, " << gone << " gone";
        }
      }
    }
}

TEST(Sequence, cubic_is_monotone_between_knots_and_smooth_across_them) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-10.0, 10.0);
  double sharpest_line = 0.0, sharpest_cubic = 0.0;
  for (int trial = 0; trial < 200; ++trial) {
    Sequence s(501, 6);  // a knot every hundred steps
    for (int j = 0; j < 6; ++j) s.knots.push_back(uniform(random));
    s.before = uniform(random);
    const std::vector<float> line = s.inputs(kFree, 0.0);
    s.cubic = true;
    const std::vector<float> cubic = s.inputs(kFree, 0.0);
    for (int j = 0; j < 6; ++j) EXPECT_NEAR(cubic[100 * j], s.knots[j], 1e-5);
    for (int t = 0; t + 1 < 501; ++t) {
      const double rise = s.knots[t / 100 + 1] - s.knots[t / 100];
      ASSERT_GE((cubic[t + 1] - cubic[t]) * rise, -1e-5) << "falls where its knots rise";
      ASSERT_LE(cubic[t], std::max(s.knots[t / 100], s.knots[t / 100 + 1]) + 1e-6);
      ASSERT_GE(cubic[t], std::min(s.knots[t / 100], s.knots[t / 100 + 1]) - 1e-6);
    }
    for (int j = 1; j < 5; ++j) {
      const auto kink = [&](const std::vector<float>& u) {
        return std::fabs(static_cast<double>(u[100 * j + 1] - 2.0f * u[100 * j] + u[100 * j - 1]));
      };
      sharpest_line = std::max(sharpest_line, kink(line));
      sharpest_cubic = std::max(sharpest_cubic, kink(cubic));
    }
  }
  std::printf("sharpest kink at a knot: lines %.4f, cubic %.4f\n", sharpest_line, sharpest_cubic);
  // the slope of a cubic does not jump: what is left is curvature, which falls with the step squared
  EXPECT_LT(sharpest_cubic, 0.1 * sharpest_line);
}

TEST(Sequence, many_periods_at_once_are_as_many_single_ones) {
  for (const std::uint32_t periods : {2u, 7u, 30u, 101u}) {
    Sequence one(40, 7), many(40, 7);
    one.knots = many.knots = {1, -2, 3, -4, 5, -6, 7};
    for (std::uint32_t i = 0; i < periods; ++i) one.advance(1);
    many.advance(periods);
    EXPECT_EQ(one.clock.phase, many.clock.phase);
    EXPECT_EQ(one.knots, many.knots);
  }
}

TEST(Command, is_within_the_step_by_the_gates_own_subtraction) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int rounded = 0;
  for (int i = 0; i < 200000; ++i) {
    const InputLimit limit = {-30.0, 20.0, std::fabs(uniform(random)) * std::pow(10.0, 3.0 * uniform(random))};
    const double last = tiller::admit_command(limit, 40.0 * uniform(random), 0.0), wish = 100.0 * uniform(random);
    const double u = tiller::limit_command(limit, wish, last);
    ASSERT_LE(std::fabs(u - last), limit.step);
    ASSERT_GE(u, limit.low);
    ASSERT_LE(u, limit.high);
    rounded += std::fabs((last + limit.step) - last) > limit.step;
    // and no nearer to `last` than it must: the wish, a limit, or the step to within rounding
    const double target = std::fmin(std::fmax(wish, limit.low), limit.high);
    ASSERT_TRUE(u == target || std::fabs(std::fabs(u - last) - limit.step) < 1e-13);
  }
  EXPECT_GT(rounded, 1000);  // the plain sum would have broken the limit
}

TEST(Command, in_force_is_admitted_or_replaced) {
  const InputLimit limit = {-1.0, 2.0, 0.1};
  EXPECT_EQ(tiller::admit_command(limit, 1.5, 0.0), 1.5);
  EXPECT_EQ(tiller::admit_command(limit, 1e300, 0.0), 2.0);
  EXPECT_EQ(tiller::admit_command(limit, -std::numeric_limits<double>::infinity(), 0.0), -1.0);
  EXPECT_EQ(tiller::admit_command(limit, std::nan(""), 0.5), 0.5);
  EXPECT_EQ(tiller::admit_command(limit, std::nan(""), std::nan("")), 0.0);
  EXPECT_EQ(tiller::admit_command({3.0, 4.0, 0.1}, std::nan(""), std::nan("")), 3.0);
}

}  // namespace
}  // namespace tiller_test
