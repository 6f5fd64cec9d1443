// Whatever goes in, what comes out is a finite command within the limits and within the rate limit of the command in
// force. ctest makes 20 000 plans, shared among the planners; TILLER_LIMIT_PLANS=10000000 in the environment as many:
//
//     TILLER_LIMIT_PLANS=10000000 planners_test --gtest_filter='*Limits*'

#include <algorithm>
#include <cstdlib>
#include <random>

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using Limits = EveryPlanner;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double pick(std::mt19937_64& random, std::initializer_list<double> values) {
  return *(values.begin() + random() % values.size());
}

std::uint32_t below(std::mt19937_64& random, std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); }

double uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// Limits from a point to the whole range of double, rates from none to infinite.
tiller::Config random_problem(std::mt19937_64& random, std::uint32_t planner) {
  tiller::Config c = line_config(planner);
  c.seed = random();
  c.planner.horizon = 2 + below(random, 12);
  c.planner.knots = 2 + below(random, 5);
  c.planner.rollouts = 16;
  c.planner.particles = 1 + below(random, 2);
  c.planner.noise_sd[0] = pick(random, {0.0, 1e-3, 2.0, 1e6, 1e300});
  c.planner.risk = below(random, 3);
  c.planner.cvar_alpha = uniform(random, 0.0, 0.99);
  c.planner.temperature = pick(random, {1e-9, 0.02, 1.0});
  c.planner.elite_fraction = pick(random, {1e-9, 0.1, 1.0});
  c.planner.interpolation = below(random, 2);
  c.planner.adapt_covariance = below(random, 2);
  c.planner.noise_colour = pick(random, {0.0, 0.5, 2.0, 4.0});
  c.planner.filter = pick(random, {0.01, 0.7, 1.0});
  c.planner.levels = 2 + below(random, 15);
  c.planner.nodes = 16 + below(random, 100);
  c.planner.hold_steps = 1 + below(random, c.planner.horizon);
  c.planner.exploration = pick(random, {0.0, 0.5, 1e3});
  const double size = pick(random, {1e-6, 1.0, 20.0, 1e6, 1e300});
  const double a = uniform(random, -size, size), b = uniform(random, -size, size);
  c.safety.input_low[0] = std::min(a, b);
  c.safety.input_high[0] = random() % 10 == 0 ? c.safety.input_low[0] : std::max(a, b);
  c.safety.input_rate_per_s[0] = pick(random, {0.0, 1e-9, 0.3, 50.0, 1e6, kInfinity}) * (size < 1e100 ? size : 1.0);
  c.safety.safe_command[0] = c.safety.input_low[0];
  return c;
}

/// Does the gate's own arithmetic agree?
void expect_within(const tiller_config_t& c, double last, double u) {
  const double low = c.safety.input_low[0], high = c.safety.input_high[0];
  ASSERT_TRUE(std::isfinite(u)) << u;
  ASSERT_GE(u, low);
  ASSERT_LE(u, high);
  if (std::isnan(last)) return;                             // no command in force: the limits alone
  const double from = std::min(std::max(last, low), high);  // one outside the limits is brought back in at once
  ASSERT_LE(std::fabs(u - from), c.safety.input_rate_per_s[0] * c.period_s) << "from " << from << " to " << u;
}

/// The rest of the plan keeps them too, up to the rounding of float.
void expect_sequence_within(const Bench& bench) {
  const tiller_config_t& c = bench.config();
  const double low = c.safety.input_low[0], high = c.safety.input_high[0];
  const double ulps = 1e-6 * std::max(std::fabs(low), std::fabs(high));
  if (high > 1e38 || low < -1e38) return;  // beyond what a float plan can tell
  const double step = c.safety.input_rate_per_s[0] * c.period_s;
  for (std::uint32_t t = 0; t < c.planner.horizon; ++t) {
    const double u = static_cast<double>(bench.sequence()[t]);
    ASSERT_GE(u, low - ulps);
    ASSERT_LE(u, high + ulps);
    const double before = t > 0 ? static_cast<double>(bench.sequence()[t - 1]) : u;
    ASSERT_LE(std::fabs(u - before), step + 2.0 * ulps);
  }
}

constexpr long kPlans = 20;  // of one configuration

/// Configurations for each planner.
long configurations() {
  const char* asked = std::getenv("TILLER_LIMIT_PLANS");
  const long plans = asked ? std::atol(asked) : 20000;
  return std::max(plans / (kPlans * static_cast<long>(tiller_planner_policy)), 1L);
}

TEST_P(Limits, are_kept_in_random_problems) {
  std::mt19937_64 random(GetParam() + 11);
  const long plans = configurations() * kPlans;
  long at_limit = 0, at_rate = 0, not_finite = 0;
  for (long i = 0; i < configurations(); ++i) {
    const tiller::Config c = random_problem(random, GetParam());
    Bench bench(c);
    for (long k = 0; k < kPlans; ++k) {
      const double bad = random() % 16 == 0 ? pick(random, {kNan, kInfinity, -kInfinity, 1e30}) : 0.0;
      bench.set_state({uniform(random, -3.0, 3.0) + bad, uniform(random, -3.0, 3.0)});
      bench.request.deadline.iterations = below(random, 3);
      if (random() % 8 == 0)
        bench.last_command[0] = pick(random, {kNan, kInfinity, -kInfinity, 1e308, -1e308, 0.0, 1e-310});
      const double last = bench.last_command[0];
      not_finite += bench.plan().status == tiller_status_plan_not_finite;
      ASSERT_NO_FATAL_FAILURE(expect_within(c, last, bench.command[0])) << "configuration " << i << ", plan " << k;
      ASSERT_NO_FATAL_FAILURE(expect_sequence_within(bench)) << "configuration " << i << ", plan " << k;
      const double u = bench.command[0];
      at_limit += u == c.safety.input_low[0] || u == c.safety.input_high[0];
      at_rate += std::fabs(u - last) >= 0.999 * c.safety.input_rate_per_s[0] * c.period_s;
    }
  }
  std::printf("%s: %ld plans, %ld at a limit, %ld at the rate limit, %ld without a finite sample\n",
              tiller::find_planner(GetParam())->name, plans, at_limit, at_rate, not_finite);
  // the problems did reach for the limits: otherwise nothing was tested
  EXPECT_GT(at_limit, plans / 100);
  EXPECT_GT(at_rate, plans / 100);
  EXPECT_GT(not_finite, plans / 1000);
}

TILLER_EVERY_PLANNER(Limits);

}  // namespace
}  // namespace tiller_test
