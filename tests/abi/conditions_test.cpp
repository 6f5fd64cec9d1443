// Each condition of the checks that decides alone: what config_check_test.cpp spoils whole, here part by part.

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "abi/config_fields.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
using C = tiller::Config;

/// The field that is refused; empty where none is.
std::string refused(const C& good, const std::function<void(C&)>& spoil) {
  C c = good;
  spoil(c);
  const char* field = "";
  return tiller_config_check(&c, &field) == tiller_status_ok ? "" : field;
}

std::string pendulum(const std::function<void(C&)>& spoil) { return refused(rig::pendulum_config(), spoil); }

TEST(Conditions, EffectsAtEveryPortCountAtEachOfThem) {
  const auto effects = [](std::uint32_t kind, std::uint32_t count, std::uint32_t port) {
    return refused(rig::cart_pole_config(), [=](C& c) {
      c.effect_count = count;
      for (std::uint32_t e = 0; e < count; ++e) c.effects[e] = {kind, port};
    });
  };
  EXPECT_EQ(effects(tiller_effect_viscous_friction, TILLER_MAX_EFFECTS / 2, TILLER_EVERY_PORT), "param_count")
      << "as many as there may be, and only then their parameters";
  EXPECT_EQ(effects(tiller_effect_viscous_friction, TILLER_MAX_EFFECTS / 2 + 1, TILLER_EVERY_PORT), "effect_count");
  EXPECT_EQ(effects(tiller_effect_lugre_friction, TILLER_MAX_EFFECT_STATES + 1, 0), "effect_count");
  EXPECT_EQ(refused(rig::cart_pole_config(),
                    [](C& c) {  // 3 of the model and 3 of each of 21 effects
                      c.effect_count = 21;
                      for (std::uint32_t e = 0; e < c.effect_count; ++e)
                        c.effects[e] = {tiller_effect_stribeck_friction, 0};
                      c.param_count = 66;
                    }),
            "param_count");
}

TEST(Conditions, PriorsReachNoFurtherThanTheirBoundsAndTheirEffects) {
  EXPECT_EQ(pendulum([](C& c) { c.priors[0] = {tiller_prior_uniform, 0, 0, 0, -kInf, 1}; }), "priors[0]");
  EXPECT_EQ(pendulum([](C& c) { c.tiller_config_t::priors = nullptr; }), "priors[0]");
  EXPECT_EQ(pendulum([](C& c) {
              c.effect_count = 1, c.effects[0] = {tiller_effect_tilt, 0}, c.param_count = 4;
              c.priors[3] = {tiller_prior_uniform, 0, 0, 0, 0, 4.0};  // radians
            }),
            "priors[3]");
  double weight[] = {1.0}, mean[] = {1.2, 0.1}, root[] = {0.1, 0.0, 0.0, 0.01};
  tiller_mixture_t mixture{sizeof(tiller_mixture_t), TILLER_CONFIG_VERSION, 1, 2, weight, mean, root};
  const auto joint = [&](C& c) { c.prior_mixture = &mixture; };
  EXPECT_EQ(pendulum(joint), "");
  weight[0] = 1.0 + 1e-8;
  EXPECT_EQ(pendulum(joint), "prior_mixture.weight");
  weight[0] = 1.0;
  mean[0] = 3e7;  // its deviations reach beyond the largest parameter
  root[0] = 1e12;
  EXPECT_EQ(pendulum([&](C& c) {
              c.priors[0] = {tiller_prior_normal, 0, 1.0, 0.1, -kInf, kInf};
              joint(c);
            }),
            "prior_mixture.mean");
}

TEST(Conditions, OfTheSettingsThatGoTogether) {
  EXPECT_EQ(pendulum([](C& c) { c.posterior.forgetting_count = 0; }), "posterior.forgetting_count");
  EXPECT_EQ(pendulum([](C& c) { c.posterior.forgetting[0] = 0.4; }), "posterior.forgetting");
  EXPECT_EQ(pendulum([](C& c) { c.posterior.forgetting[0] = 1.1; }), "posterior.forgetting");
  const auto two = [](double first, double second) {
    return pendulum([=](C& c) {
      c.posterior.kind = tiller_posterior_transition;  // of which every state is measured
      c.measurement_count = 2, c.measured_state[1] = 1, c.measurement_sd[1] = 0.02;
      c.posterior.forgetting_count = 2;
      c.posterior.forgetting[0] = first, c.posterior.forgetting[1] = second;
    });
  };
  EXPECT_EQ(two(0.99, 0.9), "");
  EXPECT_EQ(two(0.9, 0.99), "posterior.forgetting") << "they do not grow";
  EXPECT_EQ(pendulum([](C& c) { c.safety.safe_command[0] = -4.0; }), "safety.safe_command[0]");
  EXPECT_EQ(pendulum([](C& c) { c.probe.hypotheses = 1; }), "probe.hypotheses");
  double until[] = {0.1, kInf, kNan};
  EXPECT_EQ(pendulum([&](C& c) { c.probe.until_sd = until; }), "probe.until_sd[2]");
  until[2] = kInf;
  EXPECT_EQ(pendulum([&](C& c) { c.probe.until_sd = until; }), "");
}

TEST(Conditions, ADivergenceWithoutItsRowsIsToldOfTheRow) {
  static const double rows[8] = {1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0};
  const auto divergence = [](const double* mean, const double* root) {
    return pendulum([=](C& c) {
      c.cost.demonstration_mean = mean, c.cost.demonstration_root = root;
      c.cost.demonstration_steps = 2, c.cost.demonstration_weight = 1.0;
      c.cost.demonstration_divergence = tiller_divergence_kl;
      c.planner.predict_spread = 1;
    });
  };
  EXPECT_EQ(divergence(rows, rows), "");
  EXPECT_EQ(divergence(nullptr, rows), "cost.demonstration_mean");
  EXPECT_EQ(divergence(rows, nullptr), "cost.demonstration_root");
}

/// The arm, whose tip is its output.
C arm() {
  C c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("two_link_arm")), tiller_status_ok);
  for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, 0.5, 0, 0, 0};
  for (int i = 0; i < 2; ++i) c.safety.input_low[i] = -1.0, c.safety.input_high[i] = 1.0, c.planner.noise_sd[i] = 1.0;
  return c;
}

TEST(Conditions, EveryNumberOfAnOutputsCost) {
  using O = tiller_output_cost_t;
  const auto with = [](const std::function<void(O&)>& spoil) {
    static O outputs[2];
    outputs[0] = outputs[1] = {0.1, 1.0, 1.0, -1.0, 1.0, 1.0};
    spoil(outputs[1]);
    return refused(arm(), [](C& c) { c.cost.outputs = outputs, c.cost.output_count = 2; });
  };
  EXPECT_EQ(with([](O&) {}), "");
  const std::function<void(O&)> cases[] = {[](O& o) { o.target = kNan; },      [](O& o) { o.low = kNan; },
                                           [](O& o) { o.high = kNan; },        [](O& o) { o.high = o.low; },
                                           [](O& o) { o.weight = -1.0; },      [](O& o) { o.terminal_weight = kNan; },
                                           [](O& o) { o.bound_weight = kInf; }};
  for (const auto& spoil : cases) EXPECT_EQ(with(spoil), "cost.outputs[1]");
}

TEST(Conditions, OutputsAndTheirReferenceComeTogether) {
  static tiller_output_cost_t outputs[2] = {{0.1, 1.0, 1.0, -1.0, 1.0, 1.0}, {0.1, 1.0, 1.0, -1.0, 1.0, 1.0}};
  static double rows[4] = {0.1, 0.2, 0.3, 0.4};
  const auto both = [](C& c) {
    c.cost.outputs = outputs, c.cost.output_count = 2;
    c.cost.output_reference = rows, c.cost.output_reference_steps = 2;
  };
  EXPECT_EQ(refused(arm(), both), "");
  EXPECT_EQ(refused(arm(), [&](C& c) { both(c), c.cost.outputs = nullptr; }), "cost.output_count");
  EXPECT_EQ(refused(arm(), [&](C& c) { both(c), c.cost.output_count = 1; }), "cost.output_count");
  EXPECT_EQ(refused(arm(), [&](C& c) { both(c), c.cost.output_reference_steps = 0; }), "cost.output_reference_steps");
  EXPECT_EQ(refused(arm(), [&](C& c) { both(c), c.cost.output_reference = nullptr; }), "cost.output_reference_steps");
  EXPECT_EQ(refused(arm(), [&](C& c) { both(c), c.cost.outputs = nullptr, c.cost.output_count = 0; }),
            "cost.output_reference");
  rows[3] = kNan;
  EXPECT_EQ(refused(arm(), both), "cost.output_reference");
  rows[3] = 0.4;
}

TEST(Conditions, OsqpSolvesNeitherConesNorTrees) {
  const auto osqp = [](C& c) { c.planner.kind = tiller_planner_sqp, c.planner.qp_solver = tiller_qp_osqp; };
  const std::string plain = pendulum(osqp);  // refused by a build without OSQP
  EXPECT_TRUE(plain.empty() || plain == "planner.qp_solver") << plain;
  EXPECT_EQ(pendulum([&](C& c) {
              osqp(c);
              c.safety.cone_count = 1, c.cones[0] = {1, 0, 0.0, 1.0};
            }),
            "planner.qp_solver");
}

TEST(Conditions, ACostToGoThatSinglePrecisionCannotHoldIsRefused) {
  EXPECT_EQ(pendulum([](C& c) {
              c.cost.terminal = tiller_terminal_lqr;
              c.period_s = 1e-3;
              c.priors[1] = {tiller_prior_fixed, 0, 2.0, 0, 2.0, 2.0};  // long, and the torque is dear
              c.cost.state_weight[0] = c.cost.input_weight[0] = TILLER_LARGEST_WEIGHT;
            }),
            "cost.terminal");
}

TEST(Conditions, ALearntEffectNeedsTheNetworkThatFitsTheRobot) {
  static const float weights[64] = {};
  // pendulum: velocity, sine and cosine of the angle, torque
  tiller_network_t network = {
      sizeof(tiller_network_t), TILLER_CONFIG_VERSION, tiller_network_tanh, 4, 1, 1, {0, 0}, weights, 5, 0};
  const auto learnt = [&](C& c) {
    c.effect_count = 1, c.effects[0] = {tiller_effect_network, 0};
    c.network = &network;
    std::uint32_t p = c.param_count;
    c.priors[p] = {tiller_prior_fixed, 0, 1.0, 0, 1.0, 1.0};
    c.param_count = p + 1;
  };
  EXPECT_EQ(pendulum(learnt), "");
  EXPECT_EQ(pendulum([&](C& c) { learnt(c), c.network = nullptr; }), "network");
  network.inputs = 3;
  network.weight_count = 4;
  EXPECT_EQ(pendulum(learnt), "network.inputs");
  network = {sizeof(tiller_network_t), TILLER_CONFIG_VERSION, tiller_network_tanh, 4, 1, 1, {0, 0}, weights, 4, 0};
  EXPECT_EQ(pendulum(learnt), "network.weight_count");
}

TEST(Conditions, APolicysRangeIsOfNumbersInOrderOrNone) {
  static tiller_policy_t policy;
  const auto range = [](const float* low, const float* high) {
    return pendulum([=](C& c) {
      policy = *c.policy;
      policy.input_low = low, policy.input_high = high;
      c.policy = &policy;
      c.planner.kind = tiller_planner_policy;
    });
  };
  static const float good_low[] = {-1, -1, -1}, good_high[] = {1, 1, 1}, nan[] = {-1, NAN, -1}, above[] = {-1, 2, -1};
  EXPECT_EQ(range(nullptr, nullptr), "");
  EXPECT_EQ(range(good_low, good_high), "");
  EXPECT_EQ(range(nan, good_high), "policy.input_low");
  EXPECT_EQ(range(good_low, nan), "policy.input_high");
  EXPECT_EQ(range(above, good_high), "policy.input_high");
}

TEST(Conditions, OfAFieldsRange) {
  constexpr tiller::FieldRange value = tiller::ranges::value_or_none(), scale = tiller::ranges::scale_or_none();
  static_assert(value.holds(-HUGE_VAL) && value.holds(HUGE_VAL) && value.holds(0.0), "no limit on either side");
  static_assert(scale.holds(HUGE_VAL) && !scale.holds(-HUGE_VAL), "a scale has no limit above alone");
  for (const double v : {-kInf, kInf, 0.0, -1.0}) EXPECT_TRUE(value.holds(v)) << v;
  EXPECT_TRUE(scale.holds(kInf));
  for (const double v : {-kInf, kNan, 0.0, -1.0}) EXPECT_FALSE(scale.holds(v)) << v;
}

/// A plan's spread where the model has effects with states, a delay, and a force that wanders.
TEST(Conditions, OfAPredictionUnderLagDelayAndForces) {
  C config = rig::pendulum_config();
  config.effect_count = 2;
  config.effects[0] = {tiller_effect_actuator_lag, 0};
  config.effects[1] = {tiller_effect_input_delay, 0};
  config.param_count = 5;
  config.priors[3] = {tiller_prior_uniform, 0, 0, 0, 0.01, 0.03};
  config.priors[4] = {tiller_prior_uniform, 0, 0, 0, 0.02, 0.06};
  config.posterior.disturbance = 1;
  config.planner.predict_spread = 1;
  for (const std::uint32_t ahead : {0u, 1u}) {
    config.planner.predict_delay = ahead;
    const char* field = "";
    ASSERT_EQ(tiller_config_check(&config, &field), tiller_status_ok) << field;
    rig::PendulumPlant plant;
    rig::Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    loop.activate(10);
    double mean[2], sd[2], before = 0.0;
    for (std::uint32_t step = 0; step <= config.planner.horizon; step += 10) {
      ASSERT_EQ(tiller_get_prediction(loop.controller(), step, mean, sd), tiller_status_ok);
      for (int i = 0; i < 2; ++i) EXPECT_TRUE(std::isfinite(mean[i]) && sd[i] >= 0.0) << step;
      EXPECT_TRUE(step == 0 || sd[0] > 0.0);
      before = sd[0];
    }
    EXPECT_GT(before, 0.0);
  }
}

TEST(Conditions, OfWhatProbingStillWantsToKnow) {
  C config = rig::pendulum_config();
  config.probe.weight = 1.0;
  config.initial_state[0] = config.initial_state[1] = 0.0;
  double until[3] = {kInf, kInf, kInf};
  const double low[] = {-3.0, -20.0}, high[] = {3.0, 20.0};
  const auto left_after = [&](std::uint32_t ticks) {
    rig::PendulumPlant plant;
    rig::Loop loop(config, plant);
    EXPECT_TRUE(loop.ready());
    const tiller_box_t box = {sizeof(tiller_box_t), TILLER_CONFIG_VERSION, low, high, nullptr, nullptr};
    EXPECT_EQ(tiller_calibrate(loop.controller(), &box, 40), tiller_status_ok);
    loop.activate(static_cast<int>(ticks));
    EXPECT_TRUE(loop.commands_allowed());
    return loop.info().calibration_left;
  };
  config.probe.until_sd = nullptr;
  EXPECT_GT(left_after(5), 0u) << "nothing says how well is well enough";
  config.probe.until_sd = until;
  EXPECT_GT(left_after(5), 0u) << "nor does this";
  until[0] = 1e-9;
  EXPECT_GT(left_after(5), 0u) << "better than that is wished";
  until[0] = 1e9;
  EXPECT_EQ(left_after(5), 0u) << "known well enough";
  config.probe.until_sd = nullptr;
  config.posterior.enabled = 0;
  EXPECT_EQ(left_after(5), 0u) << "what is found out would be forgotten";
}

/// What a model's table may lack, one entry at a time.
// Requirement: SR-13
TEST(Conditions, OfAModelsTable) {
  using M = tiller_model_t;
  const tiller_model_t* built_in = tiller_find_model("two_link_arm");
  ASSERT_NE(built_in, nullptr);
  static const char* empty[TILLER_MAX_STATES];
  static tiller_joint_t joints[2];
  const auto check = [&](const std::function<void(M&)>& spoil) {
    M model = *built_in;
    std::copy(built_in->joints, built_in->joints + 2, joints);
    model.joints = joints;
    spoil(model);
    C c;
    std::string field;
    const tiller_status_t status = tiller_config_default(&c, &model);
    if (status == tiller_status_ok) return std::string();
    c = arm();
    c.model = &model;
    const char* name = "";
    EXPECT_EQ(tiller_config_check(&c, &name), status);
    return std::string(name);
  };
  std::copy(built_in->state_names, built_in->state_names + built_in->state_count, empty);
  empty[1] = "";
  EXPECT_EQ(check([](M&) {}), "");
  EXPECT_EQ(check([](M& m) { m.state_names = empty; }), "model.state_names");
  EXPECT_EQ(check([](M& m) { m.name = ""; }), "model.name");
  EXPECT_EQ(check([](M& m) { m.input_count = 0; }), "model.input_count");
  EXPECT_EQ(check([](M& m) { m.output_count = TILLER_MAX_OUTPUTS + 1; }), "model.output_count");
  EXPECT_EQ(check([](M& m) { m.output_names = nullptr; }), "model.output_names");
  EXPECT_EQ(check([](M& m) { m.outputs = nullptr; }), "model.outputs");
  EXPECT_EQ(check([](M& m) { m.output_count = 0, m.outputs = nullptr, m.output_names = nullptr; }), "");
  EXPECT_EQ(check([](M& m) { m.joints = nullptr; }), "model.joints");
  EXPECT_EQ(check([](M& m) { m.joint_count = 0, m.joints = nullptr, m.force_names = nullptr; }), "");
  EXPECT_EQ(check([](M&) { joints[1].name = nullptr; }), "model.joints");
  EXPECT_EQ(check([](M&) { joints[1].name = ""; }), "model.joints");
  EXPECT_EQ(check([](M&) { joints[1].position = 4; }), "model.joints");
  EXPECT_EQ(check([](M&) { joints[1].position = TILLER_NO_POSITION; }), "");
  EXPECT_EQ(check([](M&) { joints[1].force = 2; }), "model.joints");
  EXPECT_EQ(check([](M&) { joints[1].drive = 3; }), "model.joints");
  EXPECT_EQ(check([](M& m) { m.kernels = nullptr; }), "") << "the table's own dynamics do";
  EXPECT_EQ(check([](M& m) { m.dynamics = nullptr; }), "") << "and so do kernels";
}

TEST(Conditions, WhoHasNoParametersNeedsNoPriors) {
  tiller_model_t model = *tiller_find_model("pendulum");
  model.param_count = 0, model.param_names = nullptr, model.kernels = nullptr;
  model.dynamics = [](const double* x, const double* u, const double* f, const tiller_body_t*, const double*,
                      double* d) { d[0] = x[1], d[1] = u[0] + f[0]; };
  C c;
  ASSERT_EQ(tiller_config_default(&c, &model), tiller_status_ok);
  c.tiller_config_t::priors = nullptr;
  const char* field = "";
  EXPECT_NE(tiller_config_check(&c, &field), tiller_status_bad_prior) << field;
}

TEST(Conditions, EveryStateAndFeatureHasAName) {
  const char* const states[] = {"INIT", "STANDBY", "ACTIVE", "HOLD", "SAFE", "unknown"};
  for (int i = 0; i < 6; ++i) EXPECT_STREQ(tiller_state_name(static_cast<tiller_state_t>(i)), states[i]);
  const char* const features[] = {"none",         "bias",     "velocity", "velocity_sign", "input",
                                  "input_change", "previous", "size",     "position",      "unknown"};
  for (int i = 0; i <= tiller_feature_count; ++i)
    EXPECT_STREQ(tiller_feature_name(static_cast<tiller_feature_t>(i)), features[i]) << i;
  int beyond = 12;  // a number that a newer library may send
  tiller_feature_t feature;
  std::memcpy(&feature, &beyond, sizeof feature);
  EXPECT_STREQ(tiller_feature_name(feature), "unknown");
}

TEST(Conditions, OfEachCall) {
  C config = rig::pendulum_config();
  config.probe.weight = 1.0;
  rig::PendulumPlant plant;
  rig::Loop loop(config, plant);
  ASSERT_TRUE(loop.ready());
  tiller_t* const t = loop.controller();
  double values[8] = {}, nan[2] = {0.0, kNan};
  EXPECT_EQ(tiller_force_iterations(t, 100), tiller_status_ok);
  EXPECT_EQ(tiller_force_iterations(t, 101), tiller_status_bad_planner);
  EXPECT_EQ(tiller_set_target(t, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_set_target(nullptr, values), tiller_status_null_argument);
  EXPECT_EQ(tiller_set_output_target(t, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_set_output_target(nullptr, values), tiller_status_null_argument);
  EXPECT_EQ(tiller_set_reference(nullptr, values, nullptr, 1), tiller_status_null_argument);
  EXPECT_EQ(tiller_set_reference(t, nullptr, nullptr, 1), tiller_status_null_argument);
  EXPECT_EQ(tiller_set_reference(t, values, values, 1), tiller_status_bad_cost) << "there are no outputs";
  EXPECT_EQ(tiller_set_reference(t, nan, nullptr, 1), tiller_status_bad_cost);
  EXPECT_EQ(tiller_set_reference(t, values, nullptr, 2), tiller_status_ok);
  EXPECT_EQ(tiller_prepare(nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_tick(t, 0, nullptr, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_quantile(t, 0, 1.5, values), tiller_status_bad_limit);
  EXPECT_EQ(tiller_get_quantile(t, 0, -0.5, values), tiller_status_bad_limit);
  EXPECT_EQ(tiller_get_quantile(t, 0, 0.5, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_plan(t, nullptr, 1), 0u);
  EXPECT_EQ(tiller_get_covariance(t, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_outputs(nullptr, values), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_outputs(t, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_outputs(t, values), tiller_status_bad_model) << "a pendulum has no outputs";
  EXPECT_EQ(tiller_get_record(t, 0, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_contraction(t, nullptr, values, values), tiller_status_null_argument);
  tiller_hooks_t hooks = {};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION + 1;
  tiller_t* other = nullptr;
  rig::Block block(tiller_size(&config));
  EXPECT_EQ(tiller_init(&other, &config, &hooks, block.memory(), block.size()), tiller_status_version_mismatch);
}

TEST(Conditions, OfARecord) {
  C config = rig::pendulum_config();
  config.record_ticks = 4;
  rig::PendulumPlant plant;
  rig::Loop loop(config, plant);
  ASSERT_TRUE(loop.ready());
  const double target[2] = {};
  for (int calls : {8, 9, 12}) {
    for (int i = 0; i < calls; ++i) EXPECT_EQ(tiller_set_target(loop.controller(), target), tiller_status_ok);
    (void)loop.tick();
    tiller_record_t record;
    ASSERT_EQ(tiller_get_record(loop.controller(), loop.info().ticks - 1, &record), tiller_status_ok);
    EXPECT_EQ(record.calls >> 28, calls > 8 ? tiller_call_lost : tiller_call_goal) << calls;
  }
  loop.run(10);
  tiller_record_t record;
  EXPECT_EQ(tiller_get_record(loop.controller(), 0, &record), tiller_status_record_overwritten);
  EXPECT_EQ(tiller_get_record(loop.controller(), 100, &record), tiller_status_bad_dimension);
}

TEST(Conditions, OfAReferenceForOutputsAlone) {
  C config = arm();
  tiller_output_cost_t outputs[2] = {{0.1, 1.0, 1.0, -1.0, 1.0, 1.0}, {0.1, 1.0, 1.0, -1.0, 1.0, 1.0}};
  config.cost.outputs = outputs, config.cost.output_count = 2;
  rig::Block block(tiller_size(&config));
  tiller_t* t = nullptr;
  ASSERT_EQ(tiller_init(&t, &config, nullptr, block.memory(), block.size()), tiller_status_ok);
  double rows[4] = {0.1, 0.2, 0.3, 0.4}, states[8] = {};
  EXPECT_EQ(tiller_set_reference(t, nullptr, rows, 2), tiller_status_ok);
  EXPECT_EQ(tiller_set_reference(t, states, rows, 2), tiller_status_ok);
  EXPECT_EQ(tiller_set_reference(t, nullptr, rows, 0), tiller_status_bad_cost);
  EXPECT_EQ(tiller_set_output_target(t, rows), tiller_status_ok);
  EXPECT_EQ(tiller_get_outputs(t, states), tiller_status_ok);
  rows[1] = kNan;
  EXPECT_EQ(tiller_set_output_target(t, rows), tiller_status_bad_cost);
  EXPECT_EQ(tiller_set_reference(t, nullptr, rows, 2), tiller_status_bad_cost);
}

TEST(Conditions, OfACalibrationsBox) {
  C config = rig::cart_pole_config();
  config.probe.weight = 1.0;
  rig::CartPolePlant plant;
  rig::Loop loop(config, plant);
  ASSERT_TRUE(loop.ready());
  const double low[] = {-19.0}, high[] = {19.0}, above[] = {21.0}, below[] = {-21.0};
  const auto inputs = [&](const double* from, const double* to) {
    const tiller_box_t box = {sizeof(tiller_box_t), TILLER_CONFIG_VERSION, nullptr, nullptr, from, to};
    return tiller_calibrate(loop.controller(), &box, 3);
  };
  EXPECT_EQ(inputs(low, high), tiller_status_ok);
  EXPECT_EQ(inputs(nullptr, nullptr), tiller_status_ok);
  EXPECT_EQ(inputs(low, above), tiller_status_bad_limit);
  EXPECT_EQ(inputs(below, high), tiller_status_bad_limit);
  EXPECT_EQ(inputs(high, low), tiller_status_bad_limit) << "empty";
  tiller_box_t box = {8, TILLER_CONFIG_VERSION, nullptr, nullptr, nullptr, nullptr};
  EXPECT_EQ(tiller_calibrate(loop.controller(), &box, 3), tiller_status_version_mismatch);

  config.safety.input_low[0] = config.safety.input_high[0] = 0.0;  // an input that is off
  rig::Loop still(config, plant);
  ASSERT_TRUE(still.ready());
  box.size = sizeof box;
  box.input_low = high, box.input_high = low;
  EXPECT_EQ(tiller_calibrate(still.controller(), &box, 3), tiller_status_ok) << "nothing is asked of it";
}

}  // namespace
