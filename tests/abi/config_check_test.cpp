#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>

#include "rig.hpp"

// Every field that tiller_init relies on is spoiled, one at a time; the check must name that field.

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
using C = tiller_config_t;

struct Spoiled {
  const char* field;
  tiller_status_t status;
  std::function<void(C&)> spoil;
};

const Spoiled kSpoiled[] = {
    {"size", tiller_status_version_mismatch, [](C& c) { c.size = 12; }},
    {"version", tiller_status_version_mismatch, [](C& c) { c.version = 0; }},
    {"model", tiller_status_null_argument, [](C& c) { c.model = nullptr; }},
    {"period_s", tiller_status_bad_period, [](C& c) { c.period_s = 0.0; }},
    {"period_s", tiller_status_bad_period, [](C& c) { c.period_s = kNan; }},
    {"period_s", tiller_status_bad_period, [](C& c) { c.period_s = 1.5; }},
    {"substeps", tiller_status_bad_period, [](C& c) { c.substeps = 0; }},
    {"substeps", tiller_status_bad_period, [](C& c) { c.substeps = 65; }},
    {"integrator", tiller_status_bad_period, [](C& c) { c.integrator = 3; }},
    {"body.gravity_x_m_s2", tiller_status_bad_limit, [](C& c) { c.body.gravity_x_m_s2 = kNan; }},
    {"body.gravity_z_m_s2", tiller_status_bad_limit, [](C& c) { c.body.gravity_z_m_s2 = kInf; }},
    {"body.payload_kg", tiller_status_bad_limit, [](C& c) { c.body.payload_kg = -1.0; }},
    {"body.payload_kgm2", tiller_status_bad_limit, [](C& c) { c.body.payload_kgm2 = -1.0; }},
    {"effect_count", tiller_status_bad_dimension, [](C& c) { c.effect_count = 9; }},
    {"effects[0]", tiller_status_bad_effect,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {99, 0};
     }},
    {"effects[0]", tiller_status_bad_effect,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {0, 1};
     }},
    {"effects[0]", tiller_status_bad_effect,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {3, 1};
     }},
    {"param_count", tiller_status_bad_dimension,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {0, 0};
     }},
    {"param_count", tiller_status_bad_dimension, [](C& c) { c.param_count = 2; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_fixed, 0, kNan, 0, 0, 0}; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 2, 1}; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 1, 1}; }},
    {"priors[0]", tiller_status_bad_prior, [](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0, kInf}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_normal, 0, 1, 0, 0, 2}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_normal, 0, 0, 1, 9, 10}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_log_normal, 0, -1, 1, 0, 2}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2] = {tiller_prior_log_normal, 0, 1, 1, -2, -1}; }},
    {"priors[2]", tiller_status_bad_prior, [](C& c) { c.priors[2].kind = 4; }},
    {"priors[3]", tiller_status_bad_prior,
     [](C& c) {
       c.effect_count = 1, c.effects[0] = {tiller_effect_coulomb_friction, 0}, c.param_count = 4;
       c.priors[3] = {tiller_prior_uniform, 0, 0, 0, -0.1, 1};
     }},
    {"effects", tiller_status_bad_effect,
     [](C& c) {  // 1 s of delay is 50 periods
       c.effect_count = 1, c.effects[0] = {tiller_effect_input_delay, 0}, c.param_count = 4;
       c.priors[3] = {tiller_prior_uniform, 0, 0, 0, 0, 1};
     }},
    {"measurement_count", tiller_status_bad_dimension, [](C& c) { c.measurement_count = 0; }},
    {"measurement_count", tiller_status_bad_dimension, [](C& c) { c.measurement_count = 13; }},
    {"measured_state[0]", tiller_status_bad_dimension, [](C& c) { c.measured_state[0] = 2; }},
    {"measurement_sd[0]", tiller_status_bad_noise, [](C& c) { c.measurement_sd[0] = 0.0; }},
    {"measurement_sd[0]", tiller_status_bad_noise, [](C& c) { c.measurement_sd[0] = kInf; }},
    {"process_sd[0]", tiller_status_bad_noise, [](C& c) { c.process_sd[0] = -1.0; }},
    {"process_sd[1]", tiller_status_bad_noise, [](C& c) { c.process_sd[1] = 0.0; }},
    {"initial_state[1]", tiller_status_bad_seed, [](C& c) { c.initial_state[1] = kNan; }},
    {"initial_state_sd[1]", tiller_status_bad_seed, [](C& c) { c.initial_state_sd[1] = -1.0; }},
    {"posterior.particles", tiller_status_bad_posterior, [](C& c) { c.posterior.particles = 24; }},
    {"posterior.particles", tiller_status_bad_posterior, [](C& c) { c.posterior.particles = 4112; }},
    {"posterior.window", tiller_status_bad_posterior, [](C& c) { c.posterior.window = 15; }},
    {"posterior.moves_per_tick", tiller_status_bad_posterior, [](C& c) { c.posterior.moves_per_tick = 4; }},
    {"posterior.moves_per_tick", tiller_status_bad_posterior, [](C& c) { c.posterior.moves_per_tick = 72; }},
    {"posterior.ess_fraction", tiller_status_bad_posterior, [](C& c) { c.posterior.ess_fraction = 0.0; }},
    {"posterior.noise_scale_shape", tiller_status_bad_posterior, [](C& c) { c.posterior.noise_scale_shape = kNan; }},
    {"planner.kind", tiller_status_bad_planner, [](C& c) { c.planner.kind = tiller_planner_kind_count; }},
    {"planner.horizon", tiller_status_bad_planner, [](C& c) { c.planner.horizon = 1; }},
    {"planner.knots", tiller_status_bad_planner, [](C& c) { c.planner.knots = 65; }},
    {"planner.rollouts", tiller_status_bad_planner, [](C& c) { c.planner.rollouts = 20; }},
    {"planner.particles", tiller_status_bad_planner, [](C& c) { c.planner.particles = 0; }},
    {"planner.iterations", tiller_status_bad_planner, [](C& c) { c.planner.iterations = 0; }},
    {"planner.risk", tiller_status_bad_planner, [](C& c) { c.planner.risk = 2; }},
    {"planner.cvar_alpha", tiller_status_bad_planner, [](C& c) { c.planner.cvar_alpha = 1.0; }},
    {"planner.noise_sd[0]", tiller_status_bad_planner, [](C& c) { c.planner.noise_sd[0] = 0.0; }},
    {"planner.temperature", tiller_status_bad_planner, [](C& c) { c.planner.temperature = 0.0; }},
    {"planner.elite_fraction", tiller_status_bad_planner, [](C& c) { c.planner.elite_fraction = 1.5; }},
    {"planner.smoothing", tiller_status_bad_planner, [](C& c) { c.planner.smoothing = 1.0; }},
    {"cost.target[0]", tiller_status_bad_cost, [](C& c) { c.cost.target[0] = kInf; }},
    {"cost.state_weight[0]", tiller_status_bad_cost, [](C& c) { c.cost.state_weight[0] = -1.0; }},
    {"cost.terminal_weight[1]", tiller_status_bad_cost, [](C& c) { c.cost.terminal_weight[1] = kNan; }},
    {"cost.input_weight[0]", tiller_status_bad_cost, [](C& c) { c.cost.input_weight[0] = -1.0; }},
    {"cost.input_rate_weight[0]", tiller_status_bad_cost, [](C& c) { c.cost.input_rate_weight[0] = kInf; }},
    {"safety.input_low[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_low[0] = -kInf; }},
    {"safety.input_high[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_high[0] = -4.0; }},
    {"safety.input_high[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_high[0] = kNan; }},
    {"safety.input_rate_per_s[0]", tiller_status_bad_limit, [](C& c) { c.safety.input_rate_per_s[0] = 0.0; }},
    {"safety.safe_command[0]", tiller_status_bad_limit, [](C& c) { c.safety.safe_command[0] = 4.0; }},
    {"safety.hold_gain[0]", tiller_status_bad_limit, [](C& c) { c.safety.hold_gain[1] = kNan; }},
    {"safety.measurement_low[0]", tiller_status_bad_limit, [](C& c) { c.safety.measurement_low[0] = kNan; }},
    {"safety.measurement_high[0]", tiller_status_bad_limit, [](C& c) { c.safety.measurement_high[0] = -60.0; }},
    {"safety.measurement_rate_per_s[0]", tiller_status_bad_limit,
     [](C& c) { c.safety.measurement_rate_per_s[0] = -1.0; }},
    {"safety.sensor_timeout_s", tiller_status_bad_limit, [](C& c) { c.safety.sensor_timeout_s = 0.01; }},
    {"safety.sensor_timeout_s", tiller_status_bad_limit, [](C& c) { c.safety.sensor_timeout_s = kInf; }},
    {"safety.bad_ticks_to_safe", tiller_status_bad_limit, [](C& c) { c.safety.bad_ticks_to_safe = 0; }},
    {"record_ticks", tiller_status_bad_dimension, [](C& c) { c.record_ticks = 65537; }},
};

TEST(ConfigCheck, NamesTheFieldThatIsWrong) {
  const C good = rig::pendulum_config();
  const char* field = nullptr;
  ASSERT_EQ(tiller_config_check(&good, &field), tiller_status_ok) << field;
  for (const Spoiled& s : kSpoiled) {
    C c = good;
    s.spoil(c);
    EXPECT_EQ(tiller_config_check(&c, &field), s.status) << s.field;
    EXPECT_STREQ(field, s.field);
    EXPECT_EQ(tiller_size(&c), 0u) << s.field;
  }
}

/// A model table of the test's own; one member is spoiled at a time.
TEST(ConfigCheck, NamesWhatTheModelLacks) {
  const tiller_model_t* built_in = tiller_find_model("cart_pole");
  ASSERT_NE(built_in, nullptr);
  static const char* const no_names[TILLER_MAX_STATES] = {};
  static tiller_joint_t outside[2];
  outside[0] = outside[1] = built_in->joints[0];
  outside[1].velocity = 4;
  using M = tiller_model_t;
  const struct {
    const char* field;
    tiller_status_t status;
    void (*spoil)(M&);
  } cases[] = {
      {"model.size", tiller_status_version_mismatch, [](M& m) { m.size = 1; }},
      {"model.version", tiller_status_version_mismatch, [](M& m) { m.version = 9; }},
      {"model.name", tiller_status_bad_model, [](M& m) { m.name = nullptr; }},
      {"model.state_count", tiller_status_bad_model, [](M& m) { m.state_count = 0; }},
      {"model.state_count", tiller_status_bad_model, [](M& m) { m.state_count = 13; }},
      {"model.input_count", tiller_status_bad_model, [](M& m) { m.input_count = 5; }},
      {"model.param_count", tiller_status_bad_model, [](M& m) { m.param_count = 17; }},
      {"model.joint_count", tiller_status_bad_model, [](M& m) { m.joint_count = 7; }},
      {"model.state_names", tiller_status_bad_model, [](M& m) { m.state_names = no_names; }},
      {"model.input_names", tiller_status_bad_model, [](M& m) { m.input_names = nullptr; }},
      {"model.param_names", tiller_status_bad_model, [](M& m) { m.param_names = no_names; }},
      {"model.force_names", tiller_status_bad_model, [](M& m) { m.force_names = no_names; }},
      {"model.joints", tiller_status_bad_model, [](M& m) { m.joints = outside; }},
      {"model.angle_mask", tiller_status_bad_model, [](M& m) { m.angle_mask = 1u << 4; }},
      {"model.dynamics", tiller_status_bad_model,
       [](M& m) {
         m.dynamics = nullptr;
         m.kernels = nullptr;
       }},
  };
  C config = rig::cart_pole_config();
  for (const auto& c : cases) {
    M model = *built_in;
    c.spoil(model);
    config.model = &model;
    const char* field = nullptr;
    EXPECT_EQ(tiller_config_check(&config, &field), c.status) << c.field;
    EXPECT_STREQ(field, c.field);
    tiller_config_t unused;
    EXPECT_EQ(tiller_config_default(&unused, &model), c.status);
  }
}

TEST(ConfigDefault, LacksOnlyThePriors) {
  std::uint32_t models = 0;
  while (const tiller_model_t* model = tiller_builtin_model(models)) {
    ++models;
    C c;
    ASSERT_EQ(tiller_config_default(&c, model), tiller_status_ok);
    const char* field = nullptr;
    EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_prior) << model->name;
    EXPECT_STREQ(field, "priors[0]");
    for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, 0.5, 0, 0, 0};
    EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << model->name << ": " << field;
    EXPECT_EQ(tiller_find_model(model->name), model);
  }
  EXPECT_GE(models, 2u);
  EXPECT_EQ(tiller_find_model("no such model"), nullptr);
}

TEST(Status, EveryCodeHasANameAndAText) {
  const int codes[] = {
#define TILLER_STATUS(code, name, band, text) code,
#include "tiller/status.def"
#undef TILLER_STATUS
  };
  std::set<std::string> names;
  std::set<int> unique;
  for (int code : codes) {
    names.insert(tiller_status_name(static_cast<tiller_status_t>(code)));
    unique.insert(code);
    EXPECT_GT(std::string(tiller_status_text(static_cast<tiller_status_t>(code))).size(), 5u);
  }
  EXPECT_EQ(names.size(), sizeof codes / sizeof *codes);
  EXPECT_EQ(unique.size(), names.size());
  EXPECT_STREQ(tiller_status_name(static_cast<tiller_status_t>(99)), "unknown");
}

}  // namespace
