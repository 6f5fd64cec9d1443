// The cost that a plan reports is the cost of the sequence that it leaves, and it is never above that of the warm
// start. Checked with a brute-force evaluation in double.

#include <algorithm>
#include <functional>

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using Criterion = EveryPlanner;

/// alpha < 0: the mean; >= 1: the costliest particle.
tiller::Config three_masses(std::uint32_t planner, double alpha) {
  tiller::Config c = line_config(planner);
  c.planner.particles = 5;
  c.planner.horizon = 30;
  c.planner.risk = alpha < 0.0 ? tiller_risk_mean : alpha >= 1.0 ? tiller_risk_worst : tiller_risk_cvar;
  c.planner.cvar_alpha = alpha < 0.0 || alpha >= 1.0 ? 0.0 : alpha;
  c.cost.input_rate_weight[0] = 0.02;
  c.safety.input_rate_per_s[0] = 100.0;
  return c;
}

/// Cost of `sequence` for one particle, written out.
double cost_of(const Bench& bench, std::uint32_t m, double before) {
  const tiller_config_t& c = bench.config();
  const std::uint32_t count = c.planner.particles;
  double x = static_cast<double>(bench.state[m]), v = static_cast<double>(bench.state[count + m]), cost = 0.0;
  for (std::uint32_t t = 0; t < c.planner.horizon; ++t) {
    const double u = static_cast<double>(bench.sequence()[t]);
    cost += c.cost.state_weight[0] * x * x + c.cost.state_weight[1] * v * v + c.cost.input_weight[0] * u * u +
            c.cost.input_rate_weight[0] * (u - before) * (u - before);
    before = u;
    x += c.period_s * v;
    v += c.period_s * u / static_cast<double>(bench.params[m]);
  }
  return cost + c.cost.terminal_weight[0] * x * x + c.cost.terminal_weight[1] * v * v;
}

double risk_of(const Bench& bench, double before) {
  const tiller_planner_config_t& p = bench.config().planner;
  std::vector<double> costs;
  for (std::uint32_t m = 0; m < p.particles; ++m) costs.push_back(cost_of(bench, m, before));
  std::sort(costs.begin(), costs.end(), std::greater<double>());
  if (p.risk == tiller_risk_worst) return costs.front();
  const double tail = p.risk == tiller_risk_cvar ? (1.0 - p.cvar_alpha) * p.particles : p.particles;
  double left = tail, sum = 0.0;
  for (const double cost : costs) {
    const double part = std::min(left, 1.0);
    sum += part * cost;
    left -= part;
  }
  return sum / tail;
}

TEST_P(Criterion, reported_cost_is_the_sequences) {
  for (const double alpha : {-1.0, 0.0, 0.5, 0.7, 0.9, 1.0}) {
    Bench bench(three_masses(GetParam(), alpha));
    double worst = 0.0;
    for (int t = 0; t < 40; ++t) {
      bench.set_state({1.0 - 0.03 * t, 0.5 * std::sin(0.3 * t)});
      for (std::uint32_t m = 0; m < 5; ++m) bench.params[m] = 0.4f + 0.4f * static_cast<float>(m);
      const double before = bench.last_command[0];
      const tiller::PlanResult result = bench.plan();
      worst = std::max(worst, std::fabs(result.cost / risk_of(bench, before) - 1.0));
    }
    std::printf("%s alpha %.1f: largest relative error of the cost %.1e\n", tiller::find_planner(GetParam())->name,
                alpha, worst);
    EXPECT_LT(worst, 1e-5);  // costs and controls are floats: some ten roundings of 6e-8
  }
}

TEST_P(Criterion, never_rises_above_the_warm_start) {
  for (const std::uint32_t iterations : {1u, 4u}) {
    tiller::Config c = three_masses(GetParam(), 0.5);
    c.planner.rollouts = 32;  // few and wild, so that the mean of the samples is often bad
    c.planner.noise_sd[0] = 50.0;
    c.planner.iterations = iterations;
    Bench bench(c);
    int better = 0;
    for (int t = 0; t < 200; ++t) {
      bench.set_state({std::sin(0.05 * t), 0.5 * std::cos(0.07 * t)});
      for (std::uint32_t m = 0; m < 5; ++m) bench.params[m] = 0.4f + 0.4f * static_cast<float>(m);
      const double before = bench.last_command[0];
      bench.request.deadline.iterations = 0;  // the shifted plan; the same tick again goes on from there
      bench.plan_again();
      const double warm_cost = risk_of(bench, before);
      bench.request.deadline.iterations = iterations;
      const tiller::PlanResult result = bench.plan();
      EXPECT_LE(result.cost, warm_cost * (1.0 + 1e-5)) << "tick " << t;  // floats, as above
      better += result.cost < warm_cost * (1.0 - 1e-3);
    }
    std::printf("%s, %u iterations: better than the warm start in %d of 200 ticks\n",
                tiller::find_planner(GetParam())->name, iterations, better);
    EXPECT_GT(better, 20);  // and not by standing still
  }
}

TILLER_EVERY_PLANNER(Criterion);

}  // namespace
}  // namespace tiller_test
