// Properties of every effect on every model and port.

#include <gtest/gtest.h>

#include "batch.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

struct Case {
  const tiller_model_t* model;
  std::uint32_t kind, port;
};
std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (const tiller_model_t* model : all_models())
    for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
      const EffectInfo& info = effect_info(kind);
      if (info.learnt) continue;  // network_test.cpp
      for (std::uint32_t port = 0; port < port_count(info.port, *model); ++port)
        if (port_fits(info, port, *model)) cases.push_back({model, kind, port});
    }
  return cases;
}

class EveryEffect : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Effects, EveryEffect, ::testing::ValuesIn(all_cases()), [](const auto& test) {
  return std::string(test.param.model->name) + "_" + effect_info(test.param.kind).name + "_" +
         std::to_string(test.param.port);
});

TEST_P(EveryEffect, AtZeroIsTheIdentityToTheLastBit) {
  const Case c = GetParam();
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_rk4})
    for (Isa isa : all_isas()) {
      // the comparison keeps an effect with parameter zero in both, so that both take the same path of the kernel
      tiller::Config without = plain_config(c.model), with = plain_config(c.model);
      without.integrator = with.integrator = integrator;
      add_some_effect(without);
      add_some_effect(with);
      add_effect(with, c.kind, c.port);
      Batch<double> a(without, 16, 20), b(with, 16, 20);
      a.set_param(c.model->param_count, 0.0);
      b.set_param(c.model->param_count, 0.0);
      for (int i = 0; i < effect_info(c.kind).param_count; ++i) b.set_param(c.model->param_count + 1 + i, 0.0);
      a.run(*c.model, select_rollout(*c.model, isa));
      b.run(*c.model, select_rollout(*c.model, isa));
      EXPECT_EQ(a.trajectory, b.trajectory) << isa_name(isa);
      EXPECT_EQ(a.cost, b.cost) << isa_name(isa);
    }
}

// Off in the Jacobian too, and at rest, where dry friction has its kink: a gradient planner begins there.
TEST_P(EveryEffect, AtZeroIsTheIdentityInTheJacobian) {
  const Case c = GetParam();
  const std::uint32_t nx = c.model->state_count, nu = c.model->input_count, np = c.model->param_count;
  tiller::Config config = plain_config(c.model);
  add_effect(config, c.kind, c.port);
  const tiller::Config bare = plain_config(c.model);
  const std::vector<double> rest(TILLER_MAX_STATES, 0.0), history(TILLER_MAX_DELAY_STEPS * TILLER_MAX_INPUTS, 0.0);
  std::vector<double> params(TILLER_MAX_PARAMS, 0.7), place;
  for (std::uint32_t i = 0; i < nx; ++i) place.push_back(state_centre(*c.model, i));
  for (int i = 0; i < effect_info(c.kind).param_count; ++i) params[np + static_cast<std::uint32_t>(i)] = 0.0;
  for (Isa isa : all_isas()) {
    std::vector<double> a[2], b[2], next(nx * 16);
    for (int way = 0; way < 2; ++way) {
      a[way].resize(nx * nx * 16);
      b[way].resize(nx * nu * 16);
      StepSetup setup;
      ASSERT_EQ(make_step_setup(way == 0 ? bare : config, setup), tiller_status_ok);
      LineariseJob job;
      job.setup = &setup;
      job.lanes = 16;
      job.state = {place.data(), 0};
      job.params = {params.data(), 0};
      job.effect_state = {rest.data(), 0};
      job.control = {rest.data(), 0};
      job.history = history.data();
      job.next_state = next.data();
      job.a = a[way].data();
      job.b = b[way].data();
      select_rollout(*c.model, isa).linearise(*c.model, job);
    }
    for (std::size_t i = 0; i < a[0].size(); ++i) EXPECT_NEAR(a[0][i], a[1][i], 1e-14) << isa_name(isa);
    for (std::size_t i = 0; i < b[0].size(); ++i) EXPECT_NEAR(b[0][i], b[1][i], 1e-14) << isa_name(isa);
  }
}

TEST_P(EveryEffect, ChangesTheMotionWhenOn) {
  const Case c = GetParam();
  if (effect_info(c.kind).port == PortKind::sensor) return;                             // changes what is measured
  if (effect_info(c.kind).port == PortKind::body && c.model->joint_count == 0) return;  // nothing that gravity moves
  tiller::Config with = plain_config(c.model);
  add_effect(with, c.kind, c.port);
  Batch<double> off(with, 16, 20), on(with, 16, 20);
  off.set_param(c.model->param_count, 0.0);
  on.set_param(c.model->param_count, 0.05);
  off.run(*c.model, select_rollout(*c.model));
  on.run(*c.model, select_rollout(*c.model));
  EXPECT_NE(off.final_state, on.final_state);
}

bool is_spring(Scale scale) {
  return scale == Scale::force_per_position || scale == Scale::force_per_position2 ||
         scale == Scale::force_per_position3;
}

// A huge coefficient at the longest period must neither explode nor overshoot into a new oscillation.
TEST_P(EveryEffect, IsStableAtTheLargestStep) {
  const Case c = GetParam();
  const EffectInfo& info = effect_info(c.kind);
  for (double size : {1.0, 1e3, 1e6}) {
    if (info.params[0].unit == std::string("s")) size = 0.1;  // the longest delay that the prior allows
    tiller::Config with = plain_config(c.model);
    with.period_s = 0.1;
    with.substeps = 10;
    let_float(with);
    add_effect(with, c.kind, c.port);
    Batch<double> batch(with, 16, 100);
    std::fill(batch.controls.begin(), batch.controls.end(), 0.0);
    std::fill(batch.history.begin(), batch.history.end(), 0.0);
    std::fill(batch.effect_state.begin(), batch.effect_state.end(), 0.0);
    if (c.kind == tiller_effect_payload) continue;  // of a tonne at a kilogram's arm the model itself is stiff
    // springs that pull a hopper into its ground, or its leg together, meet what is stiff there
    const bool hopper = std::strcmp(c.model->name, "hopper") == 0;
    if (is_spring(info.params[0].scale) && hopper && (c.port == 1 || c.port == 4)) return;
    // a spring hands out the energy that it starts with: that of 1 N/m
    if (is_spring(info.params[0].scale))
      for (double& x : batch.state) x /= std::sqrt(size);
    if (info.params[0].low < 0.0) continue;  // an offset is a force, not something that could be stable
    for (int i = 0; i < info.param_count; ++i)
      if (info.params[i].scale != Scale::spatial_period)
        batch.set_param(c.model->param_count + static_cast<std::uint32_t>(i), size);
    batch.run(*c.model, select_rollout(*c.model));
    for (std::uint32_t i = 0; i < batch.nx * batch.lanes; ++i) {
      ASSERT_TRUE(std::isfinite(batch.final_state[i])) << size;
      EXPECT_LT(std::abs(batch.final_state[i]), 1e3) << size;
    }
  }
}

TEST_P(EveryEffect, TemplateAndTableAgree) {
  const Case c = GetParam();
  const tiller_model_t plain = as_c_model(*c.model);
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_midpoint}) {
    tiller::Config with = plain_config(c.model);
    with.integrator = integrator;
    with.substeps = 2;
    add_effect(with, c.kind, c.port);
    Batch<double> a(with, 16, 10), b(with, 16, 10);
    a.set_param(c.model->param_count, 0.07);
    b.set_param(c.model->param_count, 0.07);
    a.run(*c.model, select_rollout(*c.model));
    b.run(plain, select_rollout(plain));
    // the table's inverse inertia is a difference of accelerations: 1e-15 times their size
    for (std::size_t i = 0; i < a.final_state.size(); ++i) EXPECT_NEAR(a.final_state[i], b.final_state[i], 1e-11);
    for (std::uint32_t s = 0; s < a.setup.effect_state_count * 16; ++s)
      EXPECT_NEAR(a.final_effect[s], b.final_effect[s], 1e-12);
  }
}

/// One parameter for all inputs: the same bits as an effect at each with that value.
TEST(Setup, AnEffectAtEveryPortIsOneAtEach) {
  const tiller_model_t& m = *tiller_find_model("two_link_arm");
  for (const std::uint32_t kind : {tiller_effect_input_delay, tiller_effect_actuator_lag, tiller_effect_dead_zone}) {
    tiller::Config common = plain_config(&m), each = plain_config(&m);
    add_effect(common, kind, TILLER_EVERY_PORT);
    for (std::uint32_t input = 0; input < 2; ++input) add_effect(each, kind, input);
    Batch<double> a(common, 16, 20), b(each, 16, 20), off(common, 16, 20);
    ASSERT_EQ(a.setup.effect_count, 2u);
    ASSERT_EQ(a.setup.effect_state_count, b.setup.effect_state_count);
    a.set_param(m.param_count, 0.03);
    for (std::uint32_t input = 0; input < 2; ++input) b.set_param(m.param_count + input, 0.03);
    off.set_param(m.param_count, 0.0);
    for (Batch<double>* batch : {&a, &b, &off}) batch->run(m, select_rollout(m));
    EXPECT_EQ(a.final_state, b.final_state) << effect_info(kind).name;
    EXPECT_NE(a.final_state, off.final_state) << effect_info(kind).name;
  }
  // not where there is one port alone, nor where so many states or slots are too many
  StepSetup setup;
  tiller::Config config = plain_config(tiller_find_model("pendulum"));
  add_effect(config, tiller_effect_actuator_gain, TILLER_EVERY_PORT);
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config = plain_config(&m);
  for (int i = 0; i < 3; ++i) add_effect(config, tiller_effect_backlash, TILLER_EVERY_PORT);  // 3 states each
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config = plain_config(&m);
  for (int i = 0; i < TILLER_MAX_EFFECTS / 2 + 1; ++i)
    add_effect(config, tiller_effect_actuator_gain, TILLER_EVERY_PORT);
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
}

TEST(Setup, RefusesWhatTheModelLacks) {
  const tiller_model_t& m = *tiller_find_model("pendulum");
  StepSetup setup;
  tiller::Config config = plain_config(&m);
  add_effect(config, tiller_effect_viscous_friction, 1);
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config = plain_config(&m);
  add_effect(config, tiller_effect_actuator_lag, 1);
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config = plain_config(&m);
  config.effect_count = 1;
  config.effects[0] = {999, 0};
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config = plain_config(&m);
  add_effect(config, tiller_effect_input_delay, 0);
  config.priors[3].high = INFINITY;  // a delay without an upper bound needs memory without one
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config.priors[3].high = 0.05;
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_ok);
  EXPECT_EQ(setup.delay_steps, 3u);  // 2.5 periods
  config.param_count += 1;
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_dimension);
}

}  // namespace
}  // namespace tiller
