// What planners do in lanes, on every instruction set of this processor, against plain double arithmetic.

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>

#include "core/rng.hpp"
#include "planners/flush_to_zero.hpp"
#include "planners/lane_table.hpp"
#include "planners/sequence.hpp"

namespace tiller_test {
namespace {

using tiller::Isa;
using tiller::LaneTable;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

std::vector<Isa> present() {
  std::vector<Isa> all;
  for (int i = 0; i < tiller::kIsaCount; ++i)
    if (tiller::has_isa(static_cast<Isa>(i))) all.push_back(static_cast<Isa>(i));
  return all;
}

class Lanes : public ::testing::TestWithParam<Isa> {
 protected:
  const LaneTable& lanes = tiller::select_lanes(GetParam());
};

TEST_P(Lanes, are_those_asked_for) { EXPECT_EQ(lanes.isa, GetParam()); }

// ---- noise --------------------------------------------------------------------------------------

std::vector<tiller::NoiseKey> make_keys(std::uint64_t seed, std::uint64_t tick, std::uint32_t pairs) {
  std::vector<tiller::NoiseKey> keys(pairs);
  for (std::uint32_t p = 0; p < pairs; ++p) {
    const tiller::Philox::Words words = tiller::Philox::draw(seed, tick, p);
    for (int i = 0; i < 4; ++i) keys[p].word[i] = words.w[i];
  }
  return keys;
}

/// Standard normals (rows x lanes), from rollout `first` on.
std::vector<float> normals(const LaneTable& lanes, const std::vector<tiller::NoiseKey>& keys, std::uint32_t rows,
                           std::uint32_t n, std::uint32_t first = 0) {
  std::vector<float> out(std::size_t{rows} * n), zero(rows, 0.0f), one(rows, 1.0f), low(rows, -1e15f),
      high(rows, 1e15f);
  const std::vector<float> scale(tiller::kScales, 1.0f);
  tiller::SampleJob job;
  job.rows = rows;
  job.first_rollout = first;
  job.lanes = n;
  job.stride = n;
  job.keys = keys.data();
  job.mean = zero.data();
  job.sd = one.data();
  job.scale = scale.data();
  job.low = low.data();
  job.high = high.data();
  job.knots = out.data();
  lanes.sample(job);
  return out;
}

double correlation(const float* a, const float* b, std::size_t n) {
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) sum += static_cast<double>(a[i]) * static_cast<double>(b[i]);
  return sum / static_cast<double>(n);
}

constexpr std::uint32_t kRows = 12, kDraws = 8192;  // the largest K

TEST_P(Lanes, noise_has_the_moments_and_the_distribution_of_a_normal) {
  std::vector<double> x;
  for (std::uint64_t tick = 0; tick < 10; ++tick)
    for (const float v : normals(lanes, make_keys(3, tick, kRows / 2), kRows, kDraws))
      x.push_back(static_cast<double>(v));
  const double n = static_cast<double>(x.size());  // 983040
  double m[5] = {};
  for (const double v : x)
    for (int k = 1; k < 5; ++k) m[k] += std::pow(v, k) / n;
  std::sort(x.begin(), x.end());
  double ks = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double cdf = 0.5 * std::erfc(-x[i] / std::sqrt(2.0));
    ks = std::max({ks, std::fabs(cdf - static_cast<double>(i) / n), std::fabs(cdf - static_cast<double>(i + 1) / n)});
  }
  std::printf("%s: mean %.5f, variance %.5f, third %.5f, fourth %.5f, KS sqrt(n) D %.3f, largest %.2f\n",
              tiller::isa_name(GetParam()), m[1], m[2], m[3], m[4], ks * std::sqrt(n), x.back());
  // four standard errors of each sample moment: var x^k = 1, 2, 15, 96
  EXPECT_NEAR(m[1], 0.0, 4.0 * std::sqrt(1.0 / n));
  EXPECT_NEAR(m[2], 1.0, 4.0 * std::sqrt(2.0 / n));
  EXPECT_NEAR(m[3], 0.0, 4.0 * std::sqrt(15.0 / n));
  EXPECT_NEAR(m[4], 3.0, 4.0 * std::sqrt(96.0 / n));
  EXPECT_LT(ks * std::sqrt(n), 1.95);  // Kolmogorov's distribution: exceeded once in a thousand
  EXPECT_GT(x.back(), 4.3);            // the tail is there: the largest of a million normals is near 4.9
}

TEST_P(Lanes, noise_is_independent_across_rows_rollouts_and_ticks) {
  const double bound = 5.0 / std::sqrt(static_cast<double>(kDraws));  // five standard errors, some 1500 comparisons
  double worst = 0.0;
  std::vector<float> before;
  const auto check = [&](const float* a, const float* b, std::size_t n, const char* what) {
    const double c = correlation(a, b, n);
    worst = std::max(worst, std::fabs(c));
    EXPECT_LT(std::fabs(c), bound) << what;
  };
  for (std::uint64_t tick = 0; tick < 8; ++tick) {
    std::vector<float> now = normals(lanes, make_keys(3, tick, kRows / 2), kRows, kDraws);
    std::vector<float> squares(now);
    for (float& v : squares) v = (v * v - 1.0f) / std::sqrt(2.0f);
    for (std::uint32_t r = 0; r < kRows; ++r) {
      const float* row = now.data() + r * kDraws;
      for (std::uint32_t other = r + 1; other < kRows; ++other) {
        check(row, now.data() + other * kDraws, kDraws, "rows");
        check(squares.data() + r * kDraws, squares.data() + other * kDraws, kDraws, "squares of rows");
      }
      for (const std::uint32_t lag : {1u, 2u, 16u, 64u, 4096u}) check(row, row + lag, kDraws - lag, "rollouts");
      if (!before.empty()) check(row, before.data() + r * kDraws, kDraws, "ticks");
    }
    before.swap(now);
  }
  std::printf("%s: largest correlation %.4f, bound %.4f\n", tiller::isa_name(GetParam()), worst, bound);
}

TEST_P(Lanes, noise_is_a_function_of_the_rollouts_number) {
  const auto keys = make_keys(9, 1, 2);
  const std::vector<float> whole = normals(lanes, keys, 3, 256), part = normals(lanes, keys, 3, 64, 128);
  for (std::uint32_t r = 0; r < 3; ++r)
    for (std::uint32_t i = 0; i < 64; ++i) EXPECT_EQ(part[r * 64 + i], whole[r * 256 + 128 + i]);
}

TEST_P(Lanes, the_second_word_of_a_key_breaks_shifted_copies) {
  // The first word of a key shifts the index: alone, neighbouring keys would give one row twice, a rollout apart. Keys
  // are random, so this needs two that are within 8192 of each other; the second word makes it harmless even then.
  std::vector<tiller::NoiseKey> keys = make_keys(5, 5, 1);
  keys.push_back(keys[0]);
  for (const int i : {0, 2}) keys[1].word[i] += 1;
  const auto shifted_correlation = [&] {
    const std::vector<float> x = normals(lanes, keys, 4, kDraws);
    return correlation(x.data() + 1, x.data() + 2 * kDraws, kDraws - 1);
  };
  EXPECT_GT(shifted_correlation(), 0.9);
  for (const int i : {1, 3}) keys[1].word[i] ^= 1;     // the least difference
  EXPECT_LT(std::fabs(shifted_correlation()), 0.055);  // five standard errors
}

// ---- controls -----------------------------------------------------------------------------------

TEST_P(Lanes, controls_are_the_interpolated_rate_limited_knots) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform(-5.0f, 5.0f);
  for (const std::uint32_t horizon : {2u, 7u, 50u, 133u})
    for (const std::uint32_t knots : {2u, 3u, 6u, 20u})
      for (const double step :
           {0.3, -0.3, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
        const bool cubic = std::signbit(step);  // each limit with either curve
        constexpr std::uint32_t kInputs = 2, kLanes = 48;
        std::vector<std::uint32_t> first_step(knots);
        std::vector<float> fraction(horizon);
        tiller::KnotClock clock{horizon, knots, 0};
        tiller::advance_clock(clock, static_cast<std::uint32_t>(random() % 40));
        tiller::fill_grid(clock, first_step.data(), fraction.data());
        std::vector<float> rows(kInputs * knots * kLanes), controls(horizon * kInputs * kLanes);
        for (float& x : rows) x = uniform(random);
        const float start[kInputs] = {1.0f, -2.0f};
        const float rate = std::isinf(step) ? -1.0f : static_cast<float>(std::fabs(step));
        const float before[kInputs] = {2.5f, -4.0f};
        const double befores[kInputs] = {2.5, -4.0};
        const float rates[kInputs] = {rate, rate};
        tiller::ExpandJob job;
        job.grid = {horizon, kInputs, knots, first_step.data(), fraction.data()};
        job.lanes = job.stride = kLanes;
        job.knots = rows.data();
        job.start = start;
        job.rate_step = rates;
        job.before = cubic ? before : nullptr;
        job.controls = controls.data();
        lanes.expand(job);
        const tiller::InputLimit limits[kInputs] = {{-5.0, 5.0, std::fabs(step)}, {-5.0, 5.0, std::fabs(step)}};
        const double starts[kInputs] = {1.0, -2.0};
        for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
          std::vector<double> mean(kInputs * knots);
          for (std::size_t r = 0; r < mean.size(); ++r) mean[r] = static_cast<double>(rows[r * kLanes + lane]);
          std::vector<float> sequence(horizon * kInputs);
          tiller::expand_sequence(job.grid, limits, {}, mean.data(), starts, sequence.data(), nullptr,
                                  cubic ? befores : nullptr);
          for (std::size_t i = 0; i < sequence.size(); ++i)  // float against double: 133 roundings of 5 * 6e-8
            ASSERT_NEAR(controls[i * kLanes + lane], sequence[i], 4e-5) << horizon << " " << knots << " " << i;
        }
      }
}

// ---- risk ---------------------------------------------------------------------------------------

double sorted_risk(std::vector<double> costs, double tail) {
  std::sort(costs.begin(), costs.end(), std::greater<double>());
  double left = tail, sum = 0.0;
  for (const double cost : costs) {
    if (left <= 0.0) break;
    sum += std::min(left, 1.0) * cost;
    left -= 1.0;
  }
  return sum / tail;
}

TEST_P(Lanes, risk_is_the_mean_of_the_sorted_tail) {
  std::mt19937 random(2);
  std::lognormal_distribution<float> cost(2.0f, 1.5f);
  double worst = 0.0;
  for (const std::uint32_t particles : {1u, 2u, 5u, 8u, 32u, 64u})
    for (const double alpha : {0.0, 0.1, 0.5, 0.75, 0.9, 0.99}) {
      constexpr std::uint32_t kLanes = 80;
      std::vector<float> costs(particles * kLanes), risk(kLanes);
      for (float& c : costs) c = cost(random);
      tiller::RiskJob job;
      job.particles = particles;
      job.lanes = kLanes;
      job.tail = static_cast<float>((1.0 - alpha) * particles);
      job.cost = costs.data();
      job.risk = risk.data();
      lanes.risk(job);
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
        std::vector<double> column;
        for (std::uint32_t m = 0; m < particles; ++m) column.push_back(static_cast<double>(costs[m * kLanes + lane]));
        const double expected = sorted_risk(column, (1.0 - alpha) * particles);
        worst = std::max(worst, std::fabs(static_cast<double>(risk[lane]) / expected - 1.0));
      }
    }
  std::printf("%s: largest relative error %.1e\n", tiller::isa_name(GetParam()), worst);
  EXPECT_LT(worst, 4e-6);  // 64 roundings of 6e-8
}

/// Weights in sixteenths: a particle of weight k / 16 is k of 16 that are alike.
TEST_P(Lanes, weighted_risk_is_that_of_particles_counted_as_often_as_they_weigh) {
  std::mt19937 random(3);
  std::lognormal_distribution<float> cost(2.0f, 1.5f);
  constexpr std::uint32_t kLanes = 80, kParticles = 6;
  const std::uint32_t times[kParticles] = {1, 5, 0, 3, 2, 5};
  float weight[kParticles];
  for (std::uint32_t m = 0; m < kParticles; ++m) weight[m] = static_cast<float>(times[m]) / 16.0f;
  for (const float share : {1.0f, 0.9f, 0.5f, 0.3125f, 0.25f, 0.1f, 0.01f, 0.0f}) {
    std::vector<float> costs(kParticles * kLanes), risk(kLanes);
    for (float& c : costs) c = cost(random);
    costs[2 * kLanes + 1] = kInfinity;  // of no weight
    tiller::RiskJob job;
    job.particles = kParticles;
    job.lanes = kLanes;
    job.weight = weight;
    job.share = share;
    job.cost = costs.data();
    job.risk = risk.data();
    lanes.risk(job);
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      std::vector<double> column;
      for (std::uint32_t m = 0; m < kParticles; ++m)
        column.insert(column.end(), times[m], static_cast<double>(costs[m * kLanes + lane]));
      const double expected = sorted_risk(column, share > 0.0f ? 16.0 * static_cast<double>(share) : 1e-9);
      // t + (cost - t) / share: at 1 % the second is a hundredth of some roundings of the first
      EXPECT_NEAR(static_cast<double>(risk[lane]) / expected, 1.0, 4e-6) << share;
    }
    costs[3 * kLanes + 7] = std::numeric_limits<float>::quiet_NaN();
    costs[1 * kLanes + 8] = -kInfinity;
    lanes.risk(job);
    for (const std::uint32_t lane : {7u, 8u}) EXPECT_EQ(risk[lane], kInfinity) << share;
    EXPECT_LT(risk[9], kInfinity);
  }
}

TEST_P(Lanes, one_cost_that_is_not_finite_is_an_infinite_risk) {
  for (const float bad : {kInfinity, -kInfinity, std::numeric_limits<float>::quiet_NaN()})
    for (const float tail : {1.0f, 2.5f, 6.0f})
      for (std::uint32_t m = 0; m < 6; ++m) {
        std::vector<float> costs(6 * 16, 1.0f), risk(16);
        costs[m * 16 + 3] = bad;
        tiller::RiskJob job;
        job.particles = 6;
        job.lanes = 16;
        job.tail = tail;
        job.cost = costs.data();
        job.risk = risk.data();
        lanes.risk(job);
        for (int lane = 0; lane < 16; ++lane) EXPECT_EQ(risk[lane], lane == 3 ? kInfinity : 1.0f) << bad << " " << tail;
      }
}

// ---- reductions ---------------------------------------------------------------------------------

TEST_P(Lanes, range_counts_finite_costs_alone) {
  std::vector<float> cost(48, 7.0f);
  cost[5] = -3.0f;
  cost[17] = 90.0f;
  for (const int i : {0, 20, 47}) cost[i] = kInfinity;
  const tiller::CostRange range = lanes.range(cost.data(), 48);
  EXPECT_EQ(range.low, -3.0f);
  EXPECT_EQ(range.high, 90.0f);
  EXPECT_EQ(range.finite, 45u);
  std::fill(cost.begin(), cost.end(), kInfinity);
  EXPECT_EQ(lanes.range(cost.data(), 48).finite, 0u);
}

TEST_P(Lanes, weights_are_exponentials) {
  const tiller::FlushToZero flush;  // as in a plan
  std::vector<float> cost(64), weight(64);
  for (int i = 0; i < 64; ++i) cost[i] = 1000.0f + 0.5f * static_cast<float>(i * i);
  cost[9] = kInfinity;
  const tiller::WeightSums sums = lanes.weigh(cost.data(), 64, 1000.0f, 0.1f, weight.data());
  double sum = 0.0, squares = 0.0;
  for (int i = 0; i < 64; ++i) {
    const double exact = i == 9 ? 0.0 : std::exp(-0.05 * i * i);
    EXPECT_NEAR(static_cast<double>(weight[i]), exact, 1e-5 * exact + 2e-35) << i;  // below e^-80 it is zero
    sum += exact;
    squares += exact * exact;
  }
  EXPECT_EQ(weight[9], 0.0f);
  EXPECT_NEAR(static_cast<double>(sums.sum), sum, 1e-5 * sum);
  EXPECT_NEAR(static_cast<double>(sums.sum_of_squares), squares, 1e-5 * squares);
}

TEST_P(Lanes, moments_are_weighted_sums) {
  std::mt19937 random(4);
  std::normal_distribution<float> normal(3.0f, 2.0f);
  constexpr std::uint32_t kCount = 208, kStride = 256, kRowCount = 3;
  std::vector<float> x(kRowCount * kStride), weight(kCount);
  for (float& v : x) v = normal(random);
  for (float& w : weight) w = std::fabs(normal(random));
  const float centre[kRowCount] = {0.0f, 3.0f, -1.0f};
  float first[kRowCount], second[kRowCount], alone[kRowCount];
  lanes.moments(x.data(), kRowCount, kStride, kCount, weight.data(), centre, first, second);
  lanes.moments(x.data(), kRowCount, kStride, kCount, weight.data(), centre, alone, nullptr);
  for (std::uint32_t r = 0; r < kRowCount; ++r) {
    double sum = 0.0, squares = 0.0;
    for (std::uint32_t i = 0; i < kCount; ++i) {
      const double d = static_cast<double>(x[r * kStride + i]) - static_cast<double>(centre[r]);
      sum += static_cast<double>(weight[i]) * d;
      squares += static_cast<double>(weight[i]) * d * d;
    }
    EXPECT_NEAR(static_cast<double>(first[r]), sum, 1e-5 * squares);
    EXPECT_NEAR(static_cast<double>(second[r]), squares, 1e-5 * squares);
    EXPECT_EQ(alone[r], first[r]);
  }
}

INSTANTIATE_TEST_SUITE_P(instruction_sets, Lanes, ::testing::ValuesIn(present()),
                         [](const auto& p) { return tiller::isa_name(p.param); });

}  // namespace
}  // namespace tiller_test
