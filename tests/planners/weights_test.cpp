// Beliefs whose hypotheses are not alike: every planner under every risk, against costs and risks written out, and
// against beliefs that hold a likelier hypothesis more than once.

#include <algorithm>
#include <functional>
#include <random>

#include "planner_matrix.hpp"
#include "planners/belief_weights.hpp"
#include "planners/scenario_risk.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using WeightedBelief = EveryPlanner;

struct Atom {
  double cost, weight;
};

/// Mean of the costliest `share`; 0: the costliest.
double risk_of(std::vector<Atom> atoms, double share) {
  std::sort(atoms.begin(), atoms.end(), [](const Atom& a, const Atom& b) { return a.cost > b.cost; });
  if (share <= 0.0) return atoms.front().cost;
  double left = share, sum = 0.0;
  for (const Atom& a : atoms) {
    const double part = std::min(a.weight, left);
    sum += part * a.cost;
    left -= part;
  }
  return sum / (share - std::max(left, 0.0));
}

void set_risk(tiller::Config& c, double share) {
  c.planner.risk = share <= 0.0 ? tiller_risk_worst : share >= 1.0 ? tiller_risk_mean : tiller_risk_cvar;
  c.planner.cvar_alpha = share <= 0.0 || share >= 1.0 ? 0.0 : 1.0 - share;
}

tiller::Config masses(std::uint32_t planner, std::uint32_t count, double share) {
  tiller::Config c = line_config(planner);
  c.planner.particles = count;
  c.planner.horizon = 30;
  set_risk(c, share);
  return c;
}

double cost_of(const Bench& bench, std::uint32_t m) {
  const tiller_config_t& c = bench.config();
  const std::uint32_t count = bench.belief.count;
  double x = static_cast<double>(bench.state[m]), v = static_cast<double>(bench.state[count + m]), cost = 0.0;
  for (std::uint32_t t = 0; t < c.planner.horizon; ++t) {
    const double u = static_cast<double>(bench.sequence()[t]);
    cost += c.cost.state_weight[0] * x * x + c.cost.state_weight[1] * v * v + c.cost.input_weight[0] * u * u;
    x += c.period_s * v;
    v += c.period_s * u / static_cast<double>(bench.params[m]);
  }
  return cost + c.cost.terminal_weight[0] * x * x + c.cost.terminal_weight[1] * v * v;
}

TEST_P(WeightedBelief, reported_cost_is_the_weighted_risk_of_the_sequence) {
  const float weight[5] = {0.1f, 0.3f, 0.05f, 0.35f, 0.2f};
  for (const double share : {1.0, 0.6, 0.3, 0.1, 0.0}) {
    Bench bench(masses(GetParam(), 5, share));
    bench.belief.weight = weight;
    double worst = 0.0;
    for (int t = 0; t < 30; ++t) {
      bench.set_state({1.0 - 0.03 * t, 0.5 * std::sin(0.3 * t)});
      for (std::uint32_t m = 0; m < 5; ++m) bench.params[m] = 0.4f + 0.4f * static_cast<float>(m);
      const tiller::PlanResult result = bench.plan();
      std::vector<Atom> atoms;
      for (std::uint32_t m = 0; m < 5; ++m) atoms.push_back({cost_of(bench, m), static_cast<double>(weight[m])});
      worst = std::max(worst, std::fabs(result.cost / risk_of(atoms, share) - 1.0));
    }
    EXPECT_LT(worst, 1e-5) << "share " << share;  // floats: as in Criterion
  }
}

/// Three hypotheses, the last half of all; the same as four of which two are one.
struct Twins {
  Twins(std::uint32_t planner, double share, bool closed, bool sensors) {
    tiller::Config c = masses(planner, 4, share);
    c.planner.iterations = 4;
    c.planner.closed_loop = closed;
    if (sensors) {
      c.measurement_count = 2;
      c.measured_state[1] = 1;
      c.measurement_sd[0] = c.measurement_sd[1] = 0.01;
    }
    alike = std::make_unique<Bench>(c);
    weighted = std::make_unique<Bench>(c);
    weighted->belief.count = 3;
    weighted->belief.weight = weight;
    for (std::uint32_t m = 0; m < 4; ++m) {
      set(*alike, 4, m);
      if (m < 3) set(*weighted, 3, m);
    }
  }
  static void set(Bench& bench, std::uint32_t count, std::uint32_t m) {
    const float k = static_cast<float>(std::min(m, 2u));
    bench.params[m] = 0.6f + 0.7f * k;
    bench.state[m] = 1.0f - 0.1f * k;
    bench.state[count + m] = 0.2f * k;
  }
  const float weight[3] = {0.25f, 0.25f, 0.5f};
  std::unique_ptr<Bench> alike, weighted;
};

TEST_P(WeightedBelief, is_one_that_holds_likelier_hypotheses_twice) {
  for (const double share : {1.0, 0.4, 0.0})
    for (const bool closed : {false, true})
      for (const bool sensors : {false, true}) {
        Twins t(GetParam(), share, closed, sensors);
        const tiller::PlanResult a = t.alike->plan(), b = t.weighted->plan();
        const std::string name = std::string(tiller::find_planner(GetParam())->name) + ", share " +
                                 std::to_string(share) + (closed ? ", closed" : "") + (sensors ? ", seen" : "");
        // costs are sums of floats in another order. Planners of gradients end where their steps get small, and go on
        // with weights that two scenarios share or one has: 1e-3 of the cost is that they stop by
        EXPECT_NEAR(b.cost / a.cost, 1.0, is_gradient(GetParam()) ? 1e-3 : 2e-5) << name;
        EXPECT_NEAR(t.weighted->command[0], t.alike->command[0], is_gradient(GetParam()) ? 0.1 : 0.02) << name;
      }
}

/// Hypotheses without weight have no say, and one of infinite cost does no harm.
TEST_P(WeightedBelief, does_not_hear_hypotheses_without_weight) {
  if (is_gradient(GetParam())) return;  // their paths must be finite
  const float weight[3] = {0.5f, 0.5f, 0.0f};
  for (const double share : {1.0, 0.4, 0.0}) {
    Bench bench(masses(GetParam(), 3, share));
    bench.belief.weight = weight;
    bench.set_state({1.0, 0.0});
    bench.params[2] = 0.0f;  // no mass: infinite accelerations
    const tiller::PlanResult result = bench.plan();
    EXPECT_EQ(result.status, tiller_status_ok) << share;
    EXPECT_TRUE(std::isfinite(result.cost)) << share;
  }
}

TILLER_EVERY_PLANNER(WeightedBelief);

TEST(BeliefWeights, pairs_are_not_cut_in_two_and_the_mean_stands_for_the_rest) {
  const float weight[9] = {0.12f, 0.11f, 0.11f, 0.11f, 0.11f, 0.11f, 0.11f, 0.11f, 0.11f};
  tiller::Belief belief;
  belief.count = 9;
  EXPECT_EQ(tiller::hypotheses_within(belief, 8), 8u);
  belief.weight = weight;
  EXPECT_EQ(tiller::hypotheses_within(belief, 16), 9u);
  EXPECT_EQ(tiller::hypotheses_within(belief, 8), 7u);
  EXPECT_EQ(tiller::hypotheses_within(belief, 7), 7u);
  EXPECT_EQ(tiller::hypotheses_within(belief, 1), 1u);
  double relative[7];
  tiller::fill_relative_weights(belief, 7, relative);
  EXPECT_NEAR(relative[0], 7.0 * 0.34, 1e-6);
  for (int j = 1; j < 7; ++j) EXPECT_NEAR(relative[j], 7.0 * 0.11, 1e-6);
}

TEST(ScenarioRisk, is_that_of_scenarios_counted_as_often_as_they_are_likely) {
  std::mt19937 random(4);
  for (int trial = 0; trial < 300; ++trial) {
    const double share = trial % 3 == 0   ? 1.0
                         : trial % 3 == 1 ? 0.05 + 0.9 * static_cast<double>(random() % 100) / 100.0
                                          : 0.0;
    tiller::Config c = line_config(tiller_planner_ilqr);
    set_risk(c, share);
    tiller::ScenarioRisk risk;
    risk.lay_out(c.planner);
    risk.begin(4);
    double cost[4], times[4], sum = 0.0;
    for (int j = 0; j < 4; ++j) {
      cost[j] = static_cast<double>(random() % 1000);
      sum += times[j] = 1.0 + static_cast<double>(random() % 5);
    }
    std::vector<Atom> atoms;
    double relative[4];
    for (int j = 0; j < 4; ++j) {
      atoms.push_back({cost[j], times[j] / sum});
      relative[j] = 4.0 * times[j] / sum;
    }
    EXPECT_TRUE(risk.take_likelihoods(relative) || (relative[0] == 1.0 && relative[1] == 1.0 && relative[2] == 1.0));
    EXPECT_FALSE(risk.take_likelihoods(relative)) << "no news";
    const double value = risk.value(cost);
    EXPECT_NEAR(value, risk_of(atoms, share), 1e-9 * (1.0 + value));
    // dual ascent on costs that do not answer ends at the weights whose mean is the risk
    for (int i = 0; i < 500; ++i) (void)risk.update(cost);
    double all = 0.0, mean = 0.0;
    for (int j = 0; j < 4; ++j) {
      EXPECT_GE(risk.weight()[j], 0.0);
      if (share > 0.0) {
        EXPECT_LE(risk.weight()[j], std::min(1.0, relative[j] / 4.0 / share) + 1e-9);
      }
      all += risk.weight()[j];
      mean += risk.weight()[j] * cost[j];
    }
    EXPECT_NEAR(all, 1.0, 1e-9);
    EXPECT_NEAR(mean, value, 1e-6 * (1.0 + value));
  }
}

}  // namespace
}  // namespace tiller_test
