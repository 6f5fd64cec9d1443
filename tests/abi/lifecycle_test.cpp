#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "planners/planner.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using rig::Block;
using rig::Loop;
using rig::PendulumPlant;

TEST(Init, NeedsExactlyTheMeasuredSize) {
  for (const tiller_config_t& config : {rig::pendulum_config(), rig::cart_pole_config()}) {
    const std::size_t size = tiller_size(&config);
    ASSERT_GT(size, 0u);
    std::printf("%s: %zu bytes\n", config.model->name, size);
    Block block(size);
    tiller_t* t = nullptr;
    EXPECT_EQ(tiller_init(&t, &config, nullptr, block.memory(), size - 1), tiller_status_memory_too_small);
    EXPECT_EQ(t, nullptr);
    EXPECT_EQ(tiller_init(&t, &config, nullptr, block.memory(), size), tiller_status_ok);
    EXPECT_NE(t, nullptr);
  }
}

// Requirement: SR-14
TEST(Init, WritesNothingOutsideItsBlockInAWholeLife) {
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    tiller::Config config = rig::pendulum_config();
    config.planner.kind = kind;
    PendulumPlant plant;
    Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    loop.activate(200);
    (void)tiller_stop(loop.controller(), tiller_status_ok);
    loop.run(3);
    (void)tiller_reset(loop.controller());
    loop.activate(20);
    double q = 0.0;
    std::vector<double> covariance(std::size_t{config.param_count} * config.param_count);
    EXPECT_EQ(tiller_get_covariance(loop.controller(), covariance.data()), tiller_status_ok);
    EXPECT_EQ(tiller_get_quantile(loop.controller(), 0, 0.5, &q), tiller_status_ok);
    std::uint32_t d = 0;
    std::vector<double> ratio(config.param_count);
    EXPECT_EQ(tiller_get_contraction(loop.controller(), &d, ratio.data(), covariance.data()), tiller_status_ok);
    EXPECT_EQ(tiller_get_contraction(loop.controller(), &d, nullptr, nullptr), tiller_status_ok);
    EXPECT_LE(d, config.param_count);
    for (std::uint32_t i = 0; i < d; ++i) {
      EXPECT_GE(ratio[i], 0.0);
      double length = 0.0;
      for (std::uint32_t p = 0; p < config.param_count; ++p) {
        const double entry = covariance[i * config.param_count + p];
        length += entry * entry;
        EXPECT_TRUE(config.priors[p].kind != tiller_prior_fixed || entry == 0.0);
      }
      EXPECT_NEAR(length, 1.0, 1e-9);
    }
    EXPECT_TRUE(loop.block().canaries_alive());
  }
}

TEST(Init, RefusesWhatDoesNotFit) {
  const tiller::Config config = rig::pendulum_config();
  const std::size_t size = tiller_size(&config);
  Block block(size + 64);
  auto* memory = static_cast<unsigned char*>(block.memory());
  tiller_t* t = nullptr;
  EXPECT_EQ(tiller_init(nullptr, &config, nullptr, memory, size), tiller_status_null_argument);
  EXPECT_EQ(tiller_init(&t, nullptr, nullptr, memory, size), tiller_status_null_argument);
  EXPECT_EQ(tiller_init(&t, &config, nullptr, nullptr, size), tiller_status_null_argument);
  EXPECT_EQ(tiller_init(&t, &config, nullptr, memory + 8, size), tiller_status_memory_misaligned);
  EXPECT_EQ(tiller_init(&t, &config, nullptr, memory, 0), tiller_status_memory_too_small);

  tiller::Config old = config;
  old.version += 1;
  EXPECT_EQ(tiller_init(&t, &old, nullptr, memory, size), tiller_status_version_mismatch);
  EXPECT_EQ(tiller_size(&old), 0u);
  old = config;
  old.size -= 8;
  EXPECT_EQ(tiller_init(&t, &old, nullptr, memory, size), tiller_status_version_mismatch);

  tiller_hooks_t hooks = {};
  EXPECT_EQ(tiller_init(&t, &config, &hooks, memory, size), tiller_status_version_mismatch);
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  EXPECT_EQ(tiller_init(&t, &config, &hooks, memory, size), tiller_status_ok) << "every hook may be null";
}

// A misspelt name gives no model, and whoever does not look at the first status is told by every later one: not of a
// struct's size or version.
TEST(Calls, WithoutAModelSayThatThereIsNone) {
  tiller_config_t config;
  std::memset(&config, 0xff, sizeof config);
  EXPECT_EQ(tiller_config_default(&config, tiller_find_model("pendlum")), tiller_status_no_model);
  const char* field = "";
  EXPECT_EQ(tiller_config_check(&config, &field), tiller_status_no_model);
  EXPECT_STREQ(field, "model");
  EXPECT_EQ(tiller_size(&config), 0u);
  alignas(TILLER_ALIGNMENT) unsigned char memory[TILLER_ALIGNMENT];
  tiller_t* t = nullptr;
  EXPECT_EQ(tiller_init(&t, &config, nullptr, memory, sizeof memory), tiller_status_no_model);
  EXPECT_NE(std::strstr(tiller_status_text(tiller_status_no_model), "tiller_model_names"), nullptr);
  for (std::uint32_t i = 0; const tiller_model_t* model = tiller_builtin_model(i); ++i)
    EXPECT_NE(std::strstr(tiller_model_names(), model->name), nullptr) << tiller_model_names();
}

TEST(Calls, RefuseNull) {
  double value = 0.0;
  tiller_command_t command;
  std::memset(&command, 0xff, sizeof command);
  tiller_record_t record;
  tiller_info_t info;
  EXPECT_EQ(tiller_size(nullptr), 0u);
  EXPECT_EQ(tiller_config_default(static_cast<tiller_config_t*>(nullptr), nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_config_check(nullptr, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_arm(nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_disarm(nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_stop(nullptr, tiller_status_ok), tiller_status_null_argument);
  EXPECT_EQ(tiller_reset(nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_tick(nullptr, 0, nullptr, &command), tiller_status_null_argument);
  EXPECT_EQ(command.value[0], 0.0) << "a command is always filled";
  EXPECT_EQ(tiller_force_iterations(nullptr, 1), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_covariance(nullptr, &value), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_quantile(nullptr, 0, 0.5, &value), tiller_status_null_argument);
  std::uint32_t d = 0;
  EXPECT_EQ(tiller_get_contraction(nullptr, &d, &value, &value), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_plan(nullptr, &value, 1), 0u);
  EXPECT_EQ(tiller_get_particle(nullptr, 0, nullptr, nullptr, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_record(nullptr, 0, &record), tiller_status_null_argument);
  tiller_get_info(nullptr, &info);
  EXPECT_EQ(info.ticks, 0u);
  tiller_get_info(nullptr, nullptr);

  PendulumPlant plant;
  Loop loop(rig::pendulum_config(), plant);
  EXPECT_EQ(tiller_tick(loop.controller(), 0, nullptr, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_covariance(loop.controller(), nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_quantile(loop.controller(), 0, 0.5, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_contraction(loop.controller(), nullptr, &value, nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_quantile(loop.controller(), 99, 0.5, &value), tiller_status_bad_dimension);
  EXPECT_EQ(tiller_get_quantile(loop.controller(), 0, std::nan(""), &value), tiller_status_bad_limit);
  EXPECT_EQ(tiller_get_particle(loop.controller(), 1u << 20, nullptr, nullptr, nullptr), tiller_status_bad_dimension);
  EXPECT_EQ(tiller_get_record(loop.controller(), 0, &record), tiller_status_bad_dimension) << "no tick yet";
}

// Requirement: SR-4, SR-5, SR-6
TEST(States, FollowArmDisarmStopReset) {
  PendulumPlant plant;
  plant.angle_rad = 0.3;
  Loop loop(rig::pendulum_config(), plant);
  tiller_t* t = loop.controller();
  EXPECT_EQ(loop.info().state, tiller_state_init);
  EXPECT_EQ(loop.tick(), tiller_status_ok);
  EXPECT_EQ(loop.state(), tiller_state_standby);
  EXPECT_EQ(loop.command().value[0], 0.0);

  EXPECT_EQ(tiller_arm(t), tiller_status_ok);
  (void)loop.tick();
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_GE(loop.info().planner_iterations, 1u);
  EXPECT_EQ(tiller_reset(t), tiller_status_wrong_state) << "a reset under motion is refused";

  EXPECT_EQ(tiller_disarm(t), tiller_status_ok);
  (void)loop.tick();
  EXPECT_EQ(loop.state(), tiller_state_standby);
  EXPECT_EQ(loop.command().value[0], 0.0);

  EXPECT_EQ(tiller_arm(t), tiller_status_ok);
  loop.run(5);
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_EQ(tiller_stop(t, tiller_status_bus_off), tiller_status_ok);
  EXPECT_EQ(loop.info().state, tiller_state_safe) << "latched at once, not at the next tick";
  EXPECT_EQ(loop.tick(), tiller_status_bus_off);
  EXPECT_EQ(loop.command().value[0], 0.0);
  EXPECT_EQ(tiller_arm(t), tiller_status_wrong_state);
  EXPECT_EQ(tiller_disarm(t), tiller_status_wrong_state);
  EXPECT_EQ(tiller_stop(t, tiller_status_stopped), tiller_status_ok);
  EXPECT_EQ(loop.info().first_fault, tiller_status_bus_off) << "the first fault is kept";
  loop.run(50);
  EXPECT_EQ(loop.state(), tiller_state_safe);

  const double mass_sd = loop.info().param_sd[0];
  EXPECT_EQ(tiller_reset(t), tiller_status_ok);
  EXPECT_EQ(loop.info().first_fault, tiller_status_ok);
  (void)loop.tick();
  EXPECT_EQ(loop.state(), tiller_state_standby) << "a reset disarms";
  EXPECT_EQ(loop.info().param_sd[0], mass_sd) << "and keeps what was learned";
  EXPECT_EQ(tiller_arm(t), tiller_status_ok);
  loop.run(3);
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_TRUE(loop.commands_allowed());
}

TEST(Names, AreThoseOfTheManual) {
  EXPECT_STREQ(tiller_state_name(tiller_state_hold), "HOLD");
  EXPECT_STREQ(tiller_state_name(static_cast<tiller_state_t>(7)), "unknown");
  EXPECT_STREQ(tiller_feature_name(tiller_feature_velocity_sign), "velocity_sign");
  EXPECT_STREQ(tiller_feature_name(tiller_feature_count), "unknown");
  EXPECT_STREQ(tiller_version(), "0.2");
  EXPECT_NE(std::strlen(tiller_instruction_set()), 0u);
}

TEST(Reads, PlanIsWhatIsInForceAndWithinLimits) {
  PendulumPlant plant;
  Loop loop(rig::pendulum_config(), plant);
  std::vector<double> plan(64);
  EXPECT_EQ(tiller_get_plan(loop.controller(), plan.data(), 64), 0u) << "no plan yet";
  loop.activate(10);
  const std::uint32_t steps = tiller_get_plan(loop.controller(), plan.data(), 64);
  ASSERT_EQ(steps, loop.config().planner.horizon);
  // the gate takes its microsecond of grain off the planner's step at most
  EXPECT_NEAR(plan[0], loop.command().value[0], 1e-3);
  for (std::uint32_t i = 0; i < steps; ++i) EXPECT_LE(std::abs(plan[i]), 3.0);
  (void)loop.tick(nullptr);
  EXPECT_EQ(tiller_get_plan(loop.controller(), plan.data(), 64), steps - 1) << "a tick without sensors uses a step";
}

TEST(Reads, ParticlesAddUpToTheMoments) {
  PendulumPlant plant;
  Loop loop(rig::pendulum_config(), plant);
  loop.activate(30);
  const tiller_info_t info = loop.info();
  double sum = 0.0, mean = 0.0;
  for (std::uint32_t i = 0; i < loop.config().posterior.particles; ++i) {
    double params[TILLER_MAX_PARAMS], state[TILLER_MAX_STATES], weight = 0.0;
    ASSERT_EQ(tiller_get_particle(loop.controller(), i, params, state, &weight), tiller_status_ok);
    sum += weight;
    mean += weight * params[0];
  }
  EXPECT_NEAR(sum, 1.0, 1e-12);
  EXPECT_NEAR(mean, info.param_mean[0], 1e-12);
}

// Planners without feedback say so; those that have it give it around the plan that they also tell.
TEST(Feedback, IsGivenAroundThePlanOrRefused) {
  double gain[TILLER_MAX_INPUTS * TILLER_MAX_STATES], state[TILLER_MAX_STATES], input[TILLER_MAX_INPUTS];
  EXPECT_EQ(tiller_get_feedback(nullptr, 0, gain, state, input), tiller_status_null_argument);
  EXPECT_EQ(tiller_prepare(nullptr), tiller_status_null_argument);
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    const tiller::PlannerTable& planner = *tiller::find_planner(kind);
    tiller::Config config = rig::pendulum_config();
    config.planner.kind = kind;
    // to rest from a small angle with inputs that cost: where an input stands at its limit, its gain is zero
    config.cost.target[0] = 0.0;
    config.cost.input_weight[0] = 1.0;
    config.planner.closed_loop = planner.feedback_if_closed;
    PendulumPlant plant;
    plant.angle_rad = 0.3;
    Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    if (planner.feedback_if_closed) {
      config.planner.closed_loop = 0;
      Loop open(config, plant);
      ASSERT_TRUE(open.ready());
      EXPECT_EQ(tiller_get_feedback(open.controller(), 0, gain, state, input), tiller_status_bad_planner);
    }
    if (planner.feedback == nullptr) {
      loop.activate(5);
      EXPECT_EQ(tiller_get_feedback(loop.controller(), 0, gain, state, input), tiller_status_bad_planner);
      EXPECT_EQ(tiller_prepare(loop.controller()), tiller_status_ok) << "and preparation is nothing";
      continue;
    }
    EXPECT_EQ(tiller_get_feedback(loop.controller(), 0, gain, state, input), tiller_status_bad_dimension)
        << planner.name << ": there is no plan yet";
    loop.activate(5);
    double plan[40];
    ASSERT_EQ(tiller_get_plan(loop.controller(), plan, 40), 40u);
    double norm = 0.0;
    for (std::uint32_t step = 0; step < config.planner.horizon; ++step) {
      ASSERT_EQ(tiller_get_feedback(loop.controller(), step, gain, state, input), tiller_status_ok) << planner.name;
      EXPECT_NEAR(input[0], plan[step], 1e-4) << planner.name << ", step " << step;
      for (const double value : {gain[0], gain[1], state[0], state[1]}) ASSERT_TRUE(std::isfinite(value));
      norm += std::fabs(gain[0]) + std::fabs(gain[1]);
    }
    EXPECT_GT(norm, 0.0) << planner.name << ": a feedback that answers nothing";
    EXPECT_EQ(tiller_get_feedback(loop.controller(), config.planner.horizon, gain, state, input),
              tiller_status_bad_dimension);
    EXPECT_EQ(tiller_get_feedback(loop.controller(), 0, nullptr, nullptr, nullptr), tiller_status_ok);
  }
}

// What a plan foresees is there once it is asked for and made; its first step is the estimate.
TEST(Prediction, IsGivenWithPlansOrRefused) {
  double mean[TILLER_MAX_STATES], sd[TILLER_MAX_STATES];
  EXPECT_EQ(tiller_get_prediction(nullptr, 0, mean, sd), tiller_status_null_argument);
  tiller::Config config = rig::pendulum_config();
  PendulumPlant plant;
  Loop without(config, plant);
  ASSERT_TRUE(without.ready());
  EXPECT_EQ(tiller_get_prediction(without.controller(), 0, mean, sd), tiller_status_bad_planner);
  for (const std::uint32_t kind : {std::uint32_t{tiller_planner_mppi}, std::uint32_t{tiller_planner_ilqr}}) {
    config.planner.kind = kind;
    config.planner.predict_spread = 1;
    Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    EXPECT_EQ(tiller_get_prediction(loop.controller(), 0, mean, sd), tiller_status_wrong_state);
    loop.activate(40);
    tiller_info_t info;
    tiller_get_info(loop.controller(), &info);
    ASSERT_EQ(tiller_get_prediction(loop.controller(), 0, mean, sd), tiller_status_ok);
    for (std::uint32_t i = 0; i < 2; ++i) {
      // the particles' mean is that of a draw of some of them
      EXPECT_NEAR(mean[i], info.state_mean[i], 3.0 * info.state_sd[i] + 1e-6);
      EXPECT_GT(sd[i], 0.0);
    }
    const double at_once = sd[0];
    ASSERT_EQ(tiller_get_prediction(loop.controller(), config.planner.horizon, mean, sd), tiller_status_ok);
    EXPECT_GT(sd[0], at_once) << "what is ahead is less sure";
    EXPECT_EQ(tiller_get_prediction(loop.controller(), 0, nullptr, nullptr), tiller_status_ok);
    EXPECT_EQ(tiller_get_prediction(loop.controller(), config.planner.horizon + 1, mean, sd),
              tiller_status_bad_dimension);
  }
}

}  // namespace
