// Wasserstein-1 distances: closed forms, every assignment of small sets, and the sliced discrepancy of a log.
#include "tools/identify/wasserstein.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "problems.hpp"
#include "tools/identify/wasserstein_discrepancy.hpp"

namespace tiller::tools {
namespace {

using Values = std::vector<double>;

double distance(Values a, Values b) { return wasserstein_1d(a.data(), b.data(), a.size()); }

/// The least mean distance over all n! assignments.
double best_assignment(const Values& a, const Values& b) {
  std::vector<std::size_t> to(a.size());
  std::iota(to.begin(), to.end(), std::size_t{0});
  double least = INFINITY;
  do {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += std::fabs(a[i] - b[to[i]]);
    least = std::min(least, sum / static_cast<double>(a.size()));
  } while (std::next_permutation(to.begin(), to.end()));
  return least;
}

/// The standard normal's quantile by bisection of erfc.
double normal_quantile(double u) {
  double low = -10, high = 10;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::sqrt(2.0)) < u ? low : high) = middle;
  }
  return low;
}

Values quantiles(double mean, double sd, std::size_t n, unsigned shuffle) {
  Values v;
  for (std::size_t i = 0; i < n; ++i)
    v.push_back(mean + sd * normal_quantile((static_cast<double>(i) + 0.5) / static_cast<double>(n)));
  std::mt19937 random(shuffle);
  std::shuffle(v.begin(), v.end(), random);
  return v;
}

TEST(Wasserstein, OfTwoGaussiansIsTheMeanDifferenceOfTheirQuantiles) {
  constexpr std::size_t n = 1001;
  for (const auto& [mean, sd] : {std::pair{0.7, 1.3}, std::pair{-2.0, 0.25}, std::pair{0.0, 4.0}}) {
    double expected = 0;
    for (std::size_t i = 0; i < n; ++i)
      expected += std::fabs((mean - 0.2) + (sd - 1.3) * normal_quantile((static_cast<double>(i) + 0.5) / n)) / n;
    EXPECT_NEAR(distance(quantiles(mean, sd, n, 1), quantiles(0.2, 1.3, n, 2)), expected, 1e-12);
  }
}

// A shift moves all mass by as much; a scale by E|z| = sqrt(2 / pi) times its change. The midpoint rule over quantiles
// loses some of both tails: less than 1e-3 of it at 20,000 points.
TEST(Wasserstein, OfAShiftAndOfAScaleHasAClosedForm) {
  constexpr std::size_t n = 20000;
  EXPECT_NEAR(distance(quantiles(1.5, 0.8, n, 1), quantiles(-0.5, 0.8, n, 2)), 2.0, 1e-12);
  const double scaled = distance(quantiles(1.0, 2.0, n, 3), quantiles(1.0, 0.5, n, 4));
  EXPECT_NEAR(scaled, 1.5 * std::sqrt(2 / 3.141592653589793), 1e-3);
}

TEST(Wasserstein, IsTheBestOfAllAssignments) {
  std::mt19937 random(7);
  const auto draw = [&] { return static_cast<double>(random() % 2000) / 100 - 10; };
  for (std::size_t n = 1; n <= 7; ++n)
    for (int round = 0; round < 20; ++round) {
      Values a(n), b(n);
      for (double& v : a) v = draw();
      for (double& v : b) v = draw();
      if (round % 4 == 0) b[0] = a[0];  // ties, within and across
      if (round % 4 == 1 && n > 1) a[1] = a[0];
      EXPECT_NEAR(distance(a, b), best_assignment(a, b), 1e-12) << n;
    }
}

TEST(Wasserstein, IsAMetric) {
  const Values a = {3, -1, 4, 1, -5}, b = {9, 2, 6, -5, 3}, c = {0, 0, 1, -8, 2};
  Values shuffled = a;
  std::reverse(shuffled.begin(), shuffled.end());
  EXPECT_EQ(distance(a, shuffled), 0.0);
  EXPECT_EQ(distance(a, b), distance(b, a));
  EXPECT_GT(distance(a, b), 0.0);
  EXPECT_LE(distance(a, c), distance(a, b) + distance(b, c));
}

TEST(SliceDirections, AreFixedUnitVectorsOnAllSides) {
  const std::vector<double> d = slice_directions(64, 3);
  EXPECT_EQ(d, slice_directions(64, 3));
  double sum[3] = {};
  for (std::size_t l = 0; l < 64; ++l) {
    double square = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      square += d[3 * l + i] * d[3 * l + i];
      sum[i] += d[3 * l + i] / 64;
    }
    EXPECT_NEAR(square, 1.0, 1e-14);
  }
  // a coordinate has a deviation of 1/sqrt(3), a mean of 64 one of .072: within four of these
  for (const double s : sum) EXPECT_LT(std::fabs(s), 0.29);
  for (const double one : slice_directions(8, 1)) EXPECT_EQ(std::fabs(one), 1.0);
}

Values discrepancies(const TestLog& log, const Values& v, bool scale) {
  const MethodProblem problem = log.problem();
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  std::string error;
  EXPECT_TRUE(make_episodes(problem, episodes, error)) << error;
  DiscrepancyForm form;
  form.kind = DiscrepancyKind::wasserstein;
  form.scale = scale;
  return (*Discrepancy::make(problem, coordinates, episodes, form))(v, v.size() / 2);
}

/// Points (displacement, start, input) of every step: `a`, `b` move the displacements, or the log's own if `logged`.
std::vector<Values> points_of(const TestLog& log, double a, double b, bool logged) {
  std::vector<Values> points;
  const Grid& g = log.grids[0];
  for (std::size_t p = 0; p + 1 < g.points(); ++p) {
    const double u = g.input[0][p], v = g.input[1][p], x = g.state[0][p], y = g.state[1][p];
    if (logged)
      points.push_back({g.state[0][p + 1] - x, g.state[1][p + 1] - y, x, y, u, v});
    else
      points.push_back({0.1 * (a * u + b * v), 0.1 * (b * u - a * v), x, y, u, v});
  }
  return points;
}

/// Slices of six steps, each by all 720 assignments. `scale`: displacements over their RMS, the rest over deviations.
double sliced_by_assignment(const TestLog& log, double a, double b, bool scale) {
  std::vector<Values> logged = points_of(log, a, b, true), simulated = points_of(log, a, b, false);
  for (std::size_t j = 0; scale && j < 6; ++j) {
    double mean = 0, square = 0;
    for (const Values& p : logged) mean += j < 2 ? 0.0 : p[j] / static_cast<double>(logged.size());
    for (const Values& p : logged) square += (p[j] - mean) * (p[j] - mean) / static_cast<double>(logged.size());
    for (auto* set : {&logged, &simulated})
      for (Values& p : *set) p[j] /= std::sqrt(square);
  }
  const Values direction = slice_directions(WassersteinDiscrepancy::kDirections, 6);
  double sum = 0;
  for (std::size_t l = 0; l < WassersteinDiscrepancy::kDirections; ++l) {
    Values from, to;
    for (const Values& p : simulated) from.push_back(std::inner_product(p.begin(), p.end(), &direction[6 * l], 0.0));
    for (const Values& p : logged) to.push_back(std::inner_product(p.begin(), p.end(), &direction[6 * l], 0.0));
    sum += best_assignment(from, to);
  }
  return sum / static_cast<double>(WassersteinDiscrepancy::kDirections);
}

TEST(WassersteinDiscrepancy, IsTheMeanOfBestAssignmentsOverSlices) {
  TestLog log = linear_log(3, 0.7, 7);
  log.config.process_sd[0] = log.config.process_sd[1] = 0;  // of simulated steps
  for (const bool scale : {false, true}) {
    const Values found = discrepancies(log, {0.9, -0.3, -1.0, 2.0}, scale);
    EXPECT_NEAR(found[0], sliced_by_assignment(log, 0.9, -0.3, scale), 1e-12);
    EXPECT_NEAR(found[1], sliced_by_assignment(log, -1.0, 2.0, scale), 1e-12);
  }
}

// Displacements alone would be distributed alike for (a, b) and (-a, -b): inputs come in pairs of opposite sign.
TEST(WassersteinDiscrepancy, TellsAnswersToOppositeInputsApart) {
  TestLog log;
  log.config = linear_log(1).config;
  log.config.process_sd[0] = log.config.process_sd[1] = 0;
  Grid g;
  g.period_s = 0.1;
  g.state.assign(2, Values(41, 0.0));
  g.input.assign(2, Values(41, 0.0));
  for (std::size_t p = 0; p < 40; ++p) {
    g.input[0][p] = (p % 2 == 0 ? 1 : -1) * (1 + 0.1 * static_cast<double>(p / 2));
    g.state[0][p + 1] = g.state[0][p] + 0.1 * 0.9 * g.input[0][p];
    g.state[1][p + 1] = g.state[1][p] - 0.1 * 0.3 * g.input[0][p];
  }
  log.grids.push_back(g);
  const Values found = discrepancies(log, {0.9, -0.3, -0.9, 0.3, 0.8, -0.3}, true);
  EXPECT_NEAR(found[0], 0.0, 1e-12) << "the log's own parameters";
  EXPECT_GT(found[1], 0.1);
  EXPECT_GT(found[2], 0.001);
  EXPECT_GT(found[1], 3 * found[2]) << "nearer parameters are nearer";
}

// Noise of .22 a step beside a motion of .09: a model that moves more would be spread as the logs are, if simulated
// steps had no noise.
TEST(WassersteinDiscrepancy, NoiseOfTheLogsIsNotTakenForMotion) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    TestLog log = linear_log(seed, 0.7, 1601);
    const Values v = {0.9, -0.3, 1.6 * 0.9, 1.6 * -0.3};
    const Values with = discrepancies(log, v, true);
    EXPECT_LT(with[0], with[1]) << seed;
    log.config.process_sd[0] = log.config.process_sd[1] = 0;
    const Values without = discrepancies(log, v, true);
    EXPECT_GT(without[0], without[1]) << "else this test shows nothing; seed " << seed;
    std::printf("  seed %u: with noise %.4f, %.4f; without %.4f, %.4f\n", seed, with[0], with[1], without[0],
                without[1]);
  }
}

TEST(WassersteinDiscrepancy, FindsThePendulum) {
  for (const unsigned seed : {1u, 2u}) {
    const TestLog log = pendulum_log(seed);
    MethodProblem problem = log.problem();
    problem.options.simulations = 3000;
    problem.options.discrepancy = "wasserstein";
    MethodResult result;
    std::string error;
    ASSERT_TRUE(find_method("simopt")->run(problem, result, error)) << error;
    const MethodIteration& last = result.history.back();
    std::printf("  seed %u: mass %.4f, length %.4f\n", seed, last.mean[0], last.mean[1]);
    EXPECT_NEAR(last.mean[0], 0.4, 0.04);
    EXPECT_NEAR(last.mean[1], 0.7, 0.07);
  }
}

}  // namespace
}  // namespace tiller::tools
