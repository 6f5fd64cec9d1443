// Numbers at the ends of their ranges: what tiller_config_check accepts must run, and nothing that a controller says of
// itself may be NaN or infinite. And what used to overflow or vanish is refused by its name.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using C = tiller::Config;

constexpr double kInf = std::numeric_limits<double>::infinity();

/// Draws what a range allows, its ends above all.
class Draw {
 public:
  explicit Draw(std::uint32_t seed) : random_(seed) {}

  bool chance(double p) { return uniform() < p; }
  double uniform() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  std::uint32_t below(std::uint32_t n) { return std::uniform_int_distribution<std::uint32_t>(0, n - 1)(random_); }
  /// In [low, high], positive: an end, or any magnitude.
  double magnitude(double low, double high) {
    const double u = uniform();
    if (u < 0.3) return low;
    if (u < 0.6) return high;
    return std::exp(std::log(low) + uniform() * (std::log(high) - std::log(low)));
  }
  double sign() { return chance(0.5) ? 1.0 : -1.0; }
  double value() { return chance(0.2) ? 0.0 : sign() * magnitude(1e-30, TILLER_LARGEST_VALUE); }
  double scale() { return magnitude(TILLER_SMALLEST_SCALE, TILLER_LARGEST_SCALE); }
  double weight() { return chance(0.2) ? 0.0 : magnitude(TILLER_SMALLEST_WEIGHT, TILLER_LARGEST_WEIGHT); }

 private:
  std::mt19937 random_;
};

/// Every double field of a configuration, and how it is drawn.
void spoil(C& c, Draw& draw, double share) {
  const auto maybe = [&](double& field, const std::function<double()>& value) {
    if (draw.chance(share)) field = value();
  };
  const auto value = [&] { return draw.value(); };
  const auto scale = [&] { return draw.scale(); };
  const auto weight = [&] { return draw.weight(); };
  for (int i = 0; i < 2; ++i) {
    maybe(c.process_sd[i], scale);
    maybe(c.initial_state[i], value);
    maybe(c.initial_state_sd[i], [&] { return draw.chance(0.2) ? 0.0 : draw.scale(); });
    maybe(c.cost.target[i], value);
    maybe(c.cost.state_weight[i], weight);
    maybe(c.cost.terminal_weight[i], weight);
    maybe(c.cost.saturating_width[i], scale);
    maybe(c.bound_weight[i], weight);
    maybe(c.state_low[i], [&] { return -std::fabs(draw.value()) - 1e-9; });
    maybe(c.state_high[i], [&] { return std::fabs(draw.value()) + 1e-9; });
    c.state_low[i] = std::fmax(c.state_low[i], std::isinf(c.state_low[i]) ? -kInf : -TILLER_LARGEST_VALUE);
    c.state_high[i] = std::fmin(c.state_high[i], std::isinf(c.state_high[i]) ? kInf : TILLER_LARGEST_VALUE);
    maybe(c.hold_gain[i], value);
  }
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    maybe(c.measurement_sd[i], scale);
    maybe(c.measurement_low[i], [] { return -kInf; });
    maybe(c.measurement_high[i], [] { return kInf; });
    maybe(c.measurement_rate_per_s[i], [] { return kInf; });
  }
  maybe(c.cost.input_weight[0], weight);
  maybe(c.cost.input_rate_weight[0], weight);
  maybe(c.cost.saturating_weight, weight);
  maybe(c.planner.noise_sd[0], scale);
  maybe(c.planner.temperature, [&] { return draw.magnitude(TILLER_SMALLEST_SHARE, 1.0); });
  maybe(c.planner.elite_fraction, [&] { return draw.magnitude(TILLER_SMALLEST_SHARE, 1.0); });
  maybe(c.planner.smoothing, [&] { return TILLER_LARGEST_SHARE * draw.uniform(); });
  maybe(c.planner.cvar_alpha, [&] { return TILLER_LARGEST_SHARE * draw.uniform(); });
  maybe(c.planner.filter, [&] { return draw.magnitude(TILLER_SMALLEST_SHARE, 1.0); });
  maybe(c.planner.noise_colour, [&] { return 4.0 * draw.uniform(); });
  maybe(c.planner.anneal_iterations, [&] { return 20.0 * draw.uniform(); });
  maybe(c.planner.anneal_horizon, [&] { return 20.0 * draw.uniform(); });
  maybe(c.planner.qp_tolerance, [&] { return draw.magnitude(1e-12, 1.0); });
  maybe(c.planner.regularisation, [&] { return draw.chance(0.2) ? 0.0 : draw.magnitude(1e-12, 1e6); });
  maybe(c.planner.exploration, [&] { return draw.chance(0.2) ? 0.0 : draw.magnitude(1e-12, 1e6); });
  maybe(c.posterior.ess_fraction, [&] { return draw.magnitude(TILLER_SMALLEST_SHARE, 1.0); });
  maybe(c.posterior.noise_scale_shape, [&] { return draw.magnitude(TILLER_SMALLEST_SHARE, 1e6); });
  maybe(c.posterior.prior_proposal_fraction, [&] { return 0.5 * draw.uniform(); });
  if (draw.chance(share)) {
    const double width = draw.magnitude(1e-9, TILLER_LARGEST_VALUE);
    c.safety.input_low[0] = draw.chance(0.3) ? 0.0 : -width;
    c.safety.input_high[0] = width;
    c.safety.safe_command[0] = 0.0;
    c.safety.input_rate_per_s[0] = draw.chance(0.3) ? kInf : draw.scale();
  }
  if (draw.chance(share)) {
    c.cost.term_count = 1;
    c.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, draw.weight(), {draw.value(), draw.value(), draw.scale()}};
  }
  c.body.gravity_z_m_s2 = draw.chance(share) ? draw.sign() * draw.magnitude(1e-9, 100) : c.body.gravity_z_m_s2;
  c.body.payload_kg = draw.chance(share) ? draw.magnitude(1e-9, 1e6) : 0.0;
}

tiller_prior_t prior(Draw& draw) {
  const double a = draw.magnitude(TILLER_SMALLEST_PARAMETER, TILLER_LARGEST_PARAMETER),
               b = draw.magnitude(1e-12, TILLER_LARGEST_PARAMETER);
  switch (draw.below(4)) {
    case 0: return {tiller_prior_fixed, 0, a, 0, 0, 0};
    case 1: return {tiller_prior_uniform, 0, 0, 0, draw.chance(0.3) ? -b : 0.0, a};
    case 2: return {tiller_prior_normal, 0, draw.sign() * a, b, -kInf, kInf};
    default: return {tiller_prior_log_normal, 0, a, draw.magnitude(1e-6, 3.0), 0, kInf};
  }
}

/// All that a controller says of itself; the name of what is not finite, or null. A tick without a plan says so by an
/// infinite cost.
const char* not_finite(const tiller_info_t& info, bool planned) {
  const struct {
    const char* name;
    const double* at;
    int count;
  } fields[] = {{"effective_samples", &info.effective_samples, 1},
                {"likelihood_exponent", &info.likelihood_exponent, 1},
                {"noise_scale", &info.noise_scale, 1},
                {"acceptance", &info.acceptance, 1},
                {"state_mean", info.state_mean, TILLER_MAX_STATES},
                {"state_sd", info.state_sd, TILLER_MAX_STATES},
                {"param_mean", info.param_mean, TILLER_MAX_PARAMS},
                {"param_sd", info.param_sd, TILLER_MAX_PARAMS},
                {"adequacy_statistic", &info.adequacy_statistic, 1},
                {"noise_sd", info.noise_sd, TILLER_MAX_STATES},
                {"delay_weight", info.delay_weight, TILLER_MAX_HYPOTHESES},
                {"forgetting_weight", info.forgetting_weight, TILLER_MAX_FORGETTING},
                {"discrepancy_share", &info.discrepancy_share, 1},
                {"probe_value", &info.probe_value, 1},
                {"probe_cost", &info.probe_cost, 1},
                {"probe_spent", &info.probe_spent, 1},
                {"probe_allowed", &info.probe_allowed, 1},
                {"probe_information", &info.probe_information, 1}};
  for (const auto& field : fields)
    for (int i = 0; i < field.count; ++i)
      if (!std::isfinite(field.at[i])) return field.name;
  const bool cost = planned ? std::isfinite(info.plan_cost) : !std::isnan(info.plan_cost);
  return cost ? nullptr : "plan_cost";
}

/// The pendulum with both states measured, so that every engine can take it.
C configuration() {
  C c = rig::pendulum_config();
  c.measurement_count = 2;
  c.measured_state[0] = 0;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = 0.002;
  c.measurement_sd[1] = 0.02;
  c.measurement_low[1] = -kInf;
  c.measurement_high[1] = c.measurement_rate_per_s[1] = kInf;
  c.posterior.particles = 32;
  c.planner.horizon = 12;
  c.planner.knots = 4;
  c.planner.rollouts = 32;
  c.planner.particles = 2;
  c.planner.nodes = 64;
  c.record_ticks = 0;
  return c;
}

void choose_engines(C& c, Draw& draw) {
  c.seed = 1 + draw.below(1000);
  c.planner.kind = draw.below(tiller_planner_kind_count);
  c.planner.risk = draw.below(3);
  c.planner.closed_loop = draw.below(2);
  c.planner.shared_steps = 1 + draw.below(8);
  c.planner.predict_spread = draw.below(2);
  c.planner.noisy_rollouts = draw.below(2);
  c.planner.hypotheses = draw.below(2);
  c.cost.terminal = draw.chance(0.2) ? tiller_terminal_lqr : tiller_terminal_diagonal;
  c.posterior.kind = draw.below(tiller_posterior_kind_count);
  if (c.posterior.kind != tiller_posterior_conjugate) return;
  c.priors[0] = {tiller_prior_fixed, 0, 1.2, 0, 0, 0};
  c.priors[2] = {tiller_prior_normal, 0, 0.1, 0.05, -kInf, kInf};
}

class PlantWithRate : public rig::PendulumPlant {
 public:
  void measure(double* value) const override {
    value[0] = angle_rad;
    value[1] = rate_rad_s;
  }
};

/// What a run of a hundred ticks had.
struct Outcome {
  std::string wrong;        // what was not finite first, or empty
  std::string bad_command;  // likewise of the commands alone
  std::uint64_t plans = 0;
};

/// A hundred ticks, with an operator who resets SAFE each time.
Outcome run(const C& config) {
  Outcome result;
  PlantWithRate plant;
  rig::Loop loop(config, plant);
  if (!loop.ready()) return {"init", "init"};
  (void)tiller_arm(loop.controller());
  for (int k = 0; k < 100; ++k) {
    (void)loop.tick();
    const tiller_info_t info = loop.info();
    const char* field = not_finite(info, info.plans > result.plans);
    if (field && result.wrong.empty()) result.wrong = std::string(field) + " at tick " + std::to_string(k);
    const double u = loop.command().value[0];
    if (!(u >= config.safety.input_low[0] && u <= config.safety.input_high[0]) && result.bad_command.empty())
      result.bad_command = std::to_string(u) + " at tick " + std::to_string(k);
    result.plans = info.plans;
    if (info.state != tiller_state_safe) continue;
    (void)tiller_reset(loop.controller());
    (void)tiller_arm(loop.controller());
  }
  return result;
}

/// The ends of the ranges, of an ordinary pendulum and of parameters of any size. A pendulum of 1e-12 kg is none that
/// anybody can integrate at 20 ms: of that one the commands alone are asked for. A plan may fail, where the states that
/// it predicts leave the range; then it says so.
TEST(ConfigRange, WhatIsAcceptedRunsWithFiniteNumbers) {
  constexpr int kTrials = 900;
  constexpr double kShares[] = {0.05, 0.3, 1.0};
  int ran = 0, held = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    Draw draw(static_cast<std::uint32_t>(trial + 1));
    C c = configuration();
    choose_engines(c, draw);
    spoil(c, draw, kShares[draw.below(3)]);
    const bool ordinary = draw.chance(0.6) || c.posterior.kind == tiller_posterior_conjugate;
    if (!ordinary) c.priors[draw.below(3)] = prior(draw);
    const char* field = nullptr;
    if (tiller_config_check(&c, &field) != tiller_status_ok) continue;
    ++ran;
    const Outcome result = run(c);
    const std::string which = "trial " + std::to_string(trial) + ", planner " + std::to_string(c.planner.kind) +
                              ", posterior " + std::to_string(c.posterior.kind);
    EXPECT_EQ(result.bad_command, "") << which;
    if (!ordinary) continue;
    ++held;
    EXPECT_EQ(result.wrong, "") << which;
  }
  std::printf("%d of %d run, %d of an ordinary pendulum\n", ran, kTrials, held);
  EXPECT_GT(ran, kTrials / 2);
  EXPECT_GT(held, kTrials / 4);
}

TEST(ConfigRange, AStateMayHaveNoProcessNoise) {
  for (const std::uint32_t kind : {tiller_posterior_filter, tiller_posterior_transition}) {
    for (const std::uint32_t without : {1u, 2u, 3u}) {
      C c = configuration();
      c.posterior.kind = kind;
      c.planner.kind = tiller_planner_mppi;
      c.cost.terminal = tiller_terminal_diagonal;
      c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.8, 1.6};
      c.priors[2] = {tiller_prior_uniform, 0, 0, 0, 0.0, 0.2};
      c.process_sd[0] = 0.002;
      for (int i = 0; i < 2; ++i)
        if ((without >> i & 1u) != 0) c.process_sd[i] = 0.0;
      const char* field = nullptr;
      ASSERT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << field;
      const Outcome result = run(c);
      EXPECT_EQ(result.wrong, "") << "posterior " << kind << ", states without noise " << without;
      EXPECT_EQ(result.plans, 100u);
    }
  }
}

/// A field with its range, both ends of which are allowed; 0 and infinity where the field says so.
struct Range {
  const char* field;
  double& (*at)(C& c);
  double low, high;
  bool zero, infinity;
};

// of an array of Config, which the struct points to by the same name below `group`
#define TILLER_ARRAY_RANGE(group, name, low, high, zero, infinity)                       \
  Range {                                                                                \
#group "." #name, [](C & c) -> double& { return c.name; }, low, high, zero, infinity \
  }
#define TILLER_RANGE(name, low, high, zero, infinity)                         \
  Range {                                                                     \
#name, [](C & c) -> double& { return c.name; }, low, high, zero, infinity \
  }

const Range kRanges[] = {
    TILLER_RANGE(body.gravity_x_m_s2, -100, 100, true, false),
    TILLER_RANGE(body.gravity_z_m_s2, -100, 100, true, false),
    TILLER_RANGE(body.payload_kg, 0, 1e6, true, false),
    TILLER_RANGE(body.payload_kgm2, 0, 1e6, true, false),
    TILLER_RANGE(measurement_sd[0], 1e-9, 1e9, false, false),
    TILLER_RANGE(process_sd[1], 1e-9, 1e9, true, false),
    TILLER_RANGE(initial_state[1], -1e9, 1e9, true, false),
    TILLER_RANGE(initial_state_sd[0], 1e-9, 1e9, true, false),
    TILLER_RANGE(posterior.ess_fraction, 1e-6, 1, false, false),
    TILLER_RANGE(posterior.noise_scale_shape, 1e-6, 1e6, false, false),
    TILLER_RANGE(posterior.prior_proposal_fraction, 0, 0.5, true, false),
    TILLER_RANGE(planner.cvar_alpha, 0, 0.999, true, false),
    TILLER_RANGE(planner.noise_sd[0], 1e-9, 1e9, true, false),
    TILLER_RANGE(planner.temperature, 1e-6, 1, false, false),
    TILLER_RANGE(planner.elite_fraction, 1e-6, 1, false, false),
    TILLER_RANGE(planner.smoothing, 0, 0.999, true, false),
    TILLER_RANGE(planner.noise_colour, 0, 4, true, false),
    TILLER_RANGE(planner.anneal_iterations, 0, 20, true, false),
    TILLER_RANGE(planner.anneal_horizon, 0, 20, true, false),
    TILLER_RANGE(planner.filter, 1e-6, 1, false, false),
    TILLER_RANGE(planner.qp_tolerance, 1e-12, 1, false, false),
    TILLER_RANGE(planner.regularisation, 0, 1e6, true, false),
    TILLER_RANGE(planner.exploration, 0, 1e6, true, false),
    TILLER_RANGE(cost.bound_risk, 0, 0.5, true, false),
    TILLER_RANGE(cost.target[0], -1e9, 1e9, true, false),
    TILLER_RANGE(cost.state_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.terminal_weight[1], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.input_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.input_rate_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.saturating_weight, 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.saturating_width[1], 1e-9, 1e9, false, true),
    TILLER_ARRAY_RANGE(cost, state_high[0], -1e9, 1e9, true, true),
    TILLER_ARRAY_RANGE(cost, bound_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.own_weight, 1e-12, 1e12, true, false),
    TILLER_RANGE(safety.input_high[0], -3.0, 1e9, true, false),  // from the lower limit on
    TILLER_RANGE(safety.input_rate_per_s[0], 1e-9, 1e9, false, true),
    TILLER_ARRAY_RANGE(safety, measurement_high[0], -49.0, 1e9, true, true),
    TILLER_ARRAY_RANGE(safety, measurement_rate_per_s[0], 1e-9, 1e9, false, true),
};

double unused_cost(const double*, const double*, const double*, double, void*) { return 0.0; }

TEST(ConfigRange, EveryFieldIsHeldToWhatTheHeaderSays) {
  static const tiller_own_cost_t own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, unused_cost, nullptr,
                                        nullptr};
  for (const Range& range : kRanges) {
    const auto field_of = [&](double value) {
      C c = rig::pendulum_config();
      c.cost.own = &own;
      c.safety.safe_command[0] = -3.0;
      range.at(c) = value;
      const char* field = nullptr;
      return std::string(tiller_config_check(&c, &field) == tiller_status_ok ? "" : field);
    };
    const std::string name = range.field;
    EXPECT_EQ(field_of(range.low), "") << name << " at its low end";
    EXPECT_EQ(field_of(range.high), "") << name << " at its high end";
    EXPECT_EQ(field_of(std::nextafter(range.high, kInf)), name) << "beyond its high end";
    if (name != "safety.measurement_high[0]") {
      EXPECT_EQ(field_of(std::nextafter(range.low, -kInf)), name);
    }
    EXPECT_EQ(field_of(0.0), range.zero ? "" : name) << name << " at zero";
    EXPECT_EQ(field_of(kInf), range.infinity ? "" : name) << name << ", infinite";
    // what overflows or vanishes when it is squared, or in single precision
    for (const double v : {1e39, 1e155, 1e170, 1.7e308, std::nan("")}) EXPECT_EQ(field_of(v), name) << v;
    for (const double v : {1e-39, 1e-46, 1e-170, 5e-324})
      EXPECT_EQ(field_of(v), range.low > 0 ? name : "") << name << " = " << v;
  }
}

TEST(ConfigRange, PriorsReachNoFurtherThanAParameterMay) {
  const tiller_prior_t good[] = {
      {tiller_prior_fixed, 0, 0.0, 0, 0, 0},          {tiller_prior_fixed, 0, -1e12, 0, 0, 0},
      {tiller_prior_fixed, 0, 1e-12, 0, 0, 0},        {tiller_prior_uniform, 0, 0, 0, -1e12, 1e12},
      {tiller_prior_normal, 0, 0, 1e11, -kInf, kInf}, {tiller_prior_normal, 0, 0, 1e12, -1e12, 1e12},
      {tiller_prior_log_normal, 0, 1, 3.4, 0, kInf},  {tiller_prior_log_normal, 0, 1, 100, 1e-12, 1e12}};
  const tiller_prior_t bad[] = {
      {tiller_prior_fixed, 0, 1e13, 0, 0, 0},           {tiller_prior_fixed, 0, 1e-13, 0, 0, 0},
      {tiller_prior_fixed, 0, 5e-324, 0, 0, 0},         {tiller_prior_uniform, 0, 0, 0, -1.7e308, 1.7e308},
      {tiller_prior_uniform, 0, 0, 0, 0, 1e-39},        {tiller_prior_normal, 0, 1e39, 1, -kInf, kInf},
      {tiller_prior_normal, 0, 0, 1e155, -kInf, kInf},  {tiller_prior_normal, 0, 1, 1e-170, -kInf, kInf},
      {tiller_prior_normal, 0, 0, 1e12, -kInf, 0},      {tiller_prior_normal, 0, 0, 1, -1e300, kInf},
      {tiller_prior_log_normal, 0, 1, 3.6, 0, kInf},    {tiller_prior_log_normal, 0, 1, 1e-170, 0, kInf},
      {tiller_prior_log_normal, 0, 1e-20, 0.1, 0, kInf}};
  const auto status_of = [](const tiller_prior_t& p) {
    C c = rig::pendulum_config();
    c.priors[2] = p;
    const char* field = nullptr;
    const tiller_status_t status = tiller_config_check(&c, &field);
    if (status != tiller_status_ok) {
      EXPECT_STREQ(field, "priors[2]");
    }
    return status;
  };
  for (const tiller_prior_t& p : good) EXPECT_EQ(status_of(p), tiller_status_ok) << p.kind << " " << p.a << " " << p.b;
  for (const tiller_prior_t& p : bad)
    EXPECT_EQ(status_of(p), tiller_status_bad_prior) << p.kind << " " << p.a << " " << p.b << " " << p.low;
}

TEST(ConfigRange, RowsOfACostAreHeldToTheSame) {
  const auto field_of = [](const std::function<void(C&)>& change) {
    C c = rig::pendulum_config();
    change(c);
    const char* field = nullptr;
    return std::string(tiller_config_check(&c, &field) == tiller_status_ok ? "" : field);
  };
  static double row[4];
  const auto demonstrate = [](C& c, double mean, double root, double weight) {
    row[0] = row[3] = root, row[1] = row[2] = 0.0;
    static double means[2];
    means[0] = means[1] = mean;
    c.cost.demonstration_mean = means;
    c.cost.demonstration_root = row;
    c.cost.demonstration_steps = 1;
    c.cost.demonstration_weight = weight;
  };
  EXPECT_EQ(field_of([&](C& c) { demonstrate(c, 1e9, 1e6, 1.0); }), "");
  EXPECT_EQ(field_of([&](C& c) { demonstrate(c, 1e10, 1e3, 1.0); }), "cost.demonstration_mean");
  EXPECT_EQ(field_of([&](C& c) { demonstrate(c, 0, 1e6, 100.0); }), "cost.demonstration_root");
  EXPECT_EQ(field_of([](C& c) {
              row[0] = 1e39, row[1] = 0;
              c.cost.reference = row;
              c.cost.reference_steps = 1;
            }),
            "cost.reference");
  EXPECT_EQ(field_of([](C& c) {
              c.cost.term_count = 1;
              c.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 1, {0, 0, 1e-20}};
            }),
            "cost.terms[0]");
  EXPECT_EQ(field_of([](C& c) { c.hold_gain[0] = 1e155; }), "safety.hold_gain[0]");
}

}  // namespace
