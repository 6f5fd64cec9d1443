// Every field is held to the range that tiller.h states: both ends are allowed, and what overflows or vanishes when it
// is squared, or in single precision, is refused by its name.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "rig.hpp"

namespace {

using C = tiller_config_t;

constexpr double kInf = std::numeric_limits<double>::infinity();

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
                {"discrepancy_share", &info.discrepancy_share, 1}};
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
  c.safety.measurement_low[1] = -kInf;
  c.safety.measurement_high[1] = c.safety.measurement_rate_per_s[1] = kInf;
  c.posterior.particles = 32;
  c.planner.horizon = 12;
  c.planner.knots = 4;
  c.planner.rollouts = 32;
  c.planner.particles = 2;
  c.planner.nodes = 64;
  c.record_ticks = 0;
  return c;
}

class PlantWithRate : public rig::PendulumPlant {
 public:
  void measure(double* value) const override {
    value[0] = angle_rad;
    value[1] = rate_rad_s;
  }
};

/// A hundred ticks; what was not finite first, or an empty string. An operator who resets SAFE each time.
std::string run(const C& config, std::uint64_t& plans, std::uint64_t& failures) {
  PlantWithRate plant;
  rig::Loop loop(config, plant);
  if (!loop.ready()) return "init";
  (void)tiller_arm(loop.controller());
  plans = failures = 0;
  for (int k = 0; k < 100; ++k) {
    (void)loop.tick();
    const tiller_info_t info = loop.info();
    if (const char* field = not_finite(info, info.plans > plans))
      return std::string(field) + " at tick " + std::to_string(k);
    if (!std::isfinite(loop.command().value[0])) return "command at tick " + std::to_string(k);
    plans = info.plans;
    failures = info.plan_failures;
    if (info.state != tiller_state_safe) continue;
    (void)tiller_reset(loop.controller());
    (void)tiller_arm(loop.controller());
  }
  return "";
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
      std::uint64_t plans = 0, failures = 0;
      EXPECT_EQ(run(c, plans, failures), "") << "posterior " << kind << ", states without noise " << without;
      EXPECT_EQ(plans, 100u);
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
    TILLER_RANGE(posterior.scout_share, 0, 0.5, true, false),
    TILLER_RANGE(planner.cvar_alpha, 0, 0.999, true, false),
    TILLER_RANGE(planner.noise_sd[0], 1e-9, 1e9, false, false),
    TILLER_RANGE(planner.temperature, 1e-6, 1, false, false),
    TILLER_RANGE(planner.elite_fraction, 1e-6, 1, false, false),
    TILLER_RANGE(planner.smoothing, 0, 0.999, true, false),
    TILLER_RANGE(planner.noise_colour, 0, 4, true, false),
    TILLER_RANGE(planner.filter, 1e-6, 1, false, false),
    TILLER_RANGE(planner.qp_tolerance, 1e-12, 1, false, false),
    TILLER_RANGE(planner.regularisation, 0, 1e6, true, false),
    TILLER_RANGE(planner.exploration, 0, 1e6, true, false),
    TILLER_RANGE(cost.target[0], -1e9, 1e9, true, false),
    TILLER_RANGE(cost.state_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.terminal_weight[1], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.input_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.input_rate_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.saturating_weight, 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.saturating_width[1], 1e-9, 1e9, false, true),
    TILLER_RANGE(cost.state_high[0], -1e9, 1e9, true, true),
    TILLER_RANGE(cost.bound_weight[0], 1e-12, 1e12, true, false),
    TILLER_RANGE(cost.own_weight, 1e-12, 1e12, true, false),
    TILLER_RANGE(safety.input_high[0], -3.0, 1e9, true, false),  // from the lower limit on
    TILLER_RANGE(safety.input_rate_per_s[0], 1e-9, 1e9, false, true),
    TILLER_RANGE(safety.measurement_high[0], -49.0, 1e9, true, true),
    TILLER_RANGE(safety.measurement_rate_per_s[0], 1e-9, 1e9, false, true),
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
              c.cost.obstacle_count = 1;
              c.cost.obstacles[0] = {0, 1, 0, 0, 1e-20, 1};
            }),
            "cost.obstacles[0]");
  EXPECT_EQ(field_of([](C& c) { c.safety.hold_gain[0] = 1e155; }), "safety.hold_gain[0]");
}

}  // namespace
