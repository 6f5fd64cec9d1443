// Properties of every effect on every model and port, and the physics of each.

#include <gtest/gtest.h>

#include "batch.hpp"

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
      for (std::uint32_t port = 0; port < port_count(info.port, *model); ++port)
        if (port_fits(info, port, *model)) cases.push_back({model, kind, port});
    }
  return cases;
}

class EveryEffect : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Effects, EveryEffect, ::testing::ValuesIn(all_cases()), [](const auto& info) {
  return std::string(info.param.model->name) + "_" + effect_info(info.param.kind).name + "_" +
         std::to_string(info.param.port);
});

TEST_P(EveryEffect, AtZeroIsTheIdentityToTheLastBit) {
  const Case c = GetParam();
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_rk4})
    for (Isa isa : all_isas()) {
      // the comparison keeps an effect with parameter zero in both, so that both take the same path of the kernel
      tiller_config_t without = plain_config(c.model), with = plain_config(c.model);
      without.integrator = with.integrator = integrator;
      add_effect(without, tiller_effect_constant_offset, 0);
      add_effect(with, tiller_effect_constant_offset, 0);
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
  tiller_config_t config = plain_config(c.model);
  add_effect(config, c.kind, c.port);
  const tiller_config_t bare = plain_config(c.model);
  const std::vector<double> rest(TILLER_MAX_STATES, 0.0), history(TILLER_MAX_DELAY_STEPS * TILLER_MAX_INPUTS, 0.0);
  std::vector<double> params(TILLER_MAX_PARAMS, 0.7);
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
      job.state = {rest.data(), 0};
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
  tiller_config_t with = plain_config(c.model);
  add_effect(with, c.kind, c.port);
  Batch<double> off(with, 16, 20), on(with, 16, 20);
  off.set_param(c.model->param_count, 0.0);
  on.set_param(c.model->param_count, 0.05);
  off.run(*c.model, select_rollout(*c.model));
  on.run(*c.model, select_rollout(*c.model));
  EXPECT_NE(off.final_state, on.final_state);
}

// A huge coefficient at the longest period must neither explode nor overshoot into a new oscillation.
TEST_P(EveryEffect, IsStableAtTheLargestStep) {
  const Case c = GetParam();
  const EffectInfo& info = effect_info(c.kind);
  for (double size : {1.0, 1e3, 1e6}) {
    if (info.params[0].unit == std::string("s")) size = 0.1;  // the longest delay that the prior allows
    tiller_config_t with = plain_config(c.model);
    with.period_s = 0.1;
    with.substeps = 10;
    add_effect(with, c.kind, c.port);
    Batch<double> batch(with, 16, 100);
    std::fill(batch.controls.begin(), batch.controls.end(), 0.0);
    std::fill(batch.history.begin(), batch.history.end(), 0.0);
    std::fill(batch.effect_state.begin(), batch.effect_state.end(), 0.0);
    if (info.params[0].low < 0.0) continue;  // an offset is a force, not something that could be stable
    batch.set_param(c.model->param_count, size);
    batch.run(*c.model, select_rollout(*c.model));
    for (std::uint32_t i = 0; i < batch.nx * batch.lanes; ++i) {
      ASSERT_TRUE(std::isfinite(batch.final_state[i]));
      EXPECT_LT(std::abs(batch.final_state[i]), 1e3);
    }
  }
}

TEST_P(EveryEffect, TemplateAndTableAgree) {
  const Case c = GetParam();
  const tiller_model_t plain = as_c_model(*c.model);
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_midpoint}) {
    tiller_config_t with = plain_config(c.model);
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

// ---- physics of each ----------------------------------------------------------------------------

/// The pendulum without gravity: one inertia, one joint; formulas are closed.
struct Rotor {
  tiller_config_t config = plain_config(tiller_find_model("pendulum"));
  static constexpr double kInertia = 0.5 * 0.8 * 0.8;
  Rotor() { config.body.gravity_z_m_s2 = 0.0; }
  Batch<double> run(double param, double rate, double torque, std::uint32_t steps) {
    Batch<double> b(config, 16, steps);
    b.set_param(0, 0.5);
    b.set_param(1, 0.8);
    b.set_param(2, 0.0);
    b.set_param(3, param);
    for (std::uint32_t l = 0; l < 16; ++l) {
      b.state[l] = 0.3;
      b.state[16 + l] = rate;
    }
    std::fill(b.controls.begin(), b.controls.end(), torque);
    std::fill(b.effect_state.begin(), b.effect_state.end(), 0.0);
    std::fill(b.history.begin(), b.history.end(), 0.0);
    b.run(*config.model, select_rollout(*config.model));
    return b;
  }
  static double rate(const Batch<double>& b, std::uint32_t step) { return b.trajectory[(step * 2 + 1) * 16]; }
  static double angle(const Batch<double>& b, std::uint32_t step) { return b.trajectory[step * 2 * 16]; }
};

TEST(ViscousFriction, DecaysExponentially) {
  Rotor r;
  r.config.substeps = 64;
  add_effect(r.config, tiller_effect_viscous_friction, 0);
  const double damping = 0.2, seconds = 1.0;
  const auto b = r.run(damping, 3.0, 0.0, 50);
  const double want = 3.0 * std::exp(-damping / Rotor::kInertia * seconds);
  // implicit Euler: relative error rate^2 h t / 2 with h = .02/64
  const double rate = damping / Rotor::kInertia;
  EXPECT_NEAR(Rotor::rate(b, 50), want, want * rate * rate * (0.02 / 64) * seconds);
}

TEST(CoulombFriction, SticksExactlyAndSlidesAgainAboveItsLimit) {
  for (tiller_integrator_t integrator : {tiller_integrator_semi_implicit_euler, tiller_integrator_rk4}) {
    Rotor r;
    r.config.integrator = integrator;
    add_effect(r.config, tiller_effect_coulomb_friction, 0);
    const auto stuck = r.run(0.5, 0.4, 0.3, 100);  // torque below friction: comes to rest and stays
    EXPECT_EQ(Rotor::rate(stuck, 100), 0.0);
    EXPECT_EQ(Rotor::angle(stuck, 100), Rotor::angle(stuck, 60));
    const auto slides = r.run(0.5, 0.0, 0.8, 50);
    EXPECT_NEAR(Rotor::rate(slides, 50), (0.8 - 0.5) / Rotor::kInertia * 1.0, 1e-12);
  }
}

TEST(CoulombFriction, StopsAfterTheClosedFormTime) {
  Rotor r;
  r.config.substeps = 10;
  add_effect(r.config, tiller_effect_coulomb_friction, 0);
  const double friction = 0.4, rate0 = 2.0;
  const auto b = r.run(friction, rate0, 0.0, 100);
  const double stop_s = rate0 * Rotor::kInertia / friction;  // 1.6 s
  const auto step = static_cast<std::uint32_t>(std::ceil(stop_s / 0.02)) + 1;
  EXPECT_EQ(Rotor::rate(b, step), 0.0);
  EXPECT_GT(Rotor::rate(b, step - 3), 0.0);
  // way = rate^2 J / (2 F), within one substep's worth of motion
  EXPECT_NEAR(Rotor::angle(b, 100) - 0.3, rate0 * rate0 * Rotor::kInertia / (2 * friction), 2.0 * 0.002);
}

TEST(ConstantOffset, AcceleratesSteadily) {
  Rotor r;
  add_effect(r.config, tiller_effect_constant_offset, 0);
  const auto b = r.run(-0.25, 0.0, 0.0, 50);
  EXPECT_NEAR(Rotor::rate(b, 50), -0.25 / Rotor::kInertia, 1e-12);
}

TEST(ActuatorLag, StepResponse) {
  Rotor r;
  add_effect(r.config, tiller_effect_actuator_lag, 0);
  const double lag = 0.07, torque = 0.9;
  const auto b = r.run(lag, 0.0, torque, 50);
  EXPECT_NEAR(b.final_effect[0], torque * (1 - std::exp(-1.0 / lag)), 1e-12);
  for (std::uint32_t step : {1u, 5u, 50u}) {
    const double t = step * 0.02;  // rate = torque / J (t - T (1 - e^(-t/T))): exact, the mean over each step acts
    EXPECT_NEAR(Rotor::rate(b, step), torque / Rotor::kInertia * (t - lag * (1 - std::exp(-t / lag))), 1e-12);
  }
}

TEST(InputDelay, ShiftsTheCommandByAnyFraction) {
  for (double delay : {0.02, 0.05, 0.033, 0.1}) {
    Rotor r;
    add_effect(r.config, tiller_effect_input_delay, 0);
    const double torque = 0.9;
    const auto b = r.run(delay, 0.0, torque, 50);
    for (std::uint32_t step : {1u, 3u, 5u, 20u}) {
      const double t = step * 0.02;
      const auto whole = static_cast<std::uint32_t>(delay / 0.02 + 1e-9);
      // the impulse up to the end of a step that lies past the delay is exact; within the step of the onset too,
      // because the mean acts
      const double want = t > delay ? torque / Rotor::kInertia * (t - delay) : 0.0;
      EXPECT_NEAR(Rotor::rate(b, step), want, 1e-12) << delay << " step " << step << " whole " << whole;
    }
  }
}

TEST(InputDelay, ReadsTheHistoryOfCommands) {
  Rotor r;
  add_effect(r.config, tiller_effect_input_delay, 0);
  Batch<double> b(r.config, 16, 3);
  b.set_param(0, 0.5);
  b.set_param(1, 0.8);
  b.set_param(2, 0.0);
  b.set_param(3, 0.04);  // two periods
  std::fill(b.state.begin(), b.state.end(), 0.0);
  const double past[] = {0.7, -0.2};  // one and two periods ago
  b.history[0] = past[0];
  b.history[1] = past[1];
  b.run(*r.config.model, select_rollout(*r.config.model));
  const double gain = 0.02 / Rotor::kInertia;
  EXPECT_NEAR(Rotor::rate(b, 1), past[1] * gain, 1e-14);
  EXPECT_NEAR(Rotor::rate(b, 2), (past[1] + past[0]) * gain, 1e-14);
  EXPECT_NEAR(Rotor::rate(b, 3), (past[1] + past[0] + b.controls[0]) * gain, 1e-14);
}

// Friction at the cart's joint must act through the whole mechanism: momentum along the rail is kept but for friction.
TEST(Friction, GoesThroughTheModelsOwnInertia) {
  const tiller_model_t& m = *tiller_find_model("cart_pole");
  tiller_config_t config = plain_config(&m);
  config.substeps = 64;
  config.body.gravity_z_m_s2 = 0.0;
  add_effect(config, tiller_effect_viscous_friction, 0);
  Batch<double> b(config, 16, 50);
  std::fill(b.controls.begin(), b.controls.end(), 0.0);
  const double damping = 0.3;
  b.set_param(3, damping);
  b.run(m, select_rollout(m));
  for (std::uint32_t l = 0; l < 16; ++l) {
    const double cart = b.params[l], pole = b.params[16 + l], half = b.params[32 + l];
    const auto at = [&](std::uint32_t step, int i) { return b.trajectory[(step * 4 + i) * 16 + l]; };
    const auto momentum = [&](std::uint32_t k) {
      return (cart + pole) * at(k, 2) + pole * half * std::cos(at(k, 1)) * at(k, 3);
    };
    const double lost = damping * (at(50, 0) - at(0, 0));  // integral of damping * velocity, exactly
    EXPECT_NEAR(momentum(50) - momentum(0), -lost, 2e-4 * (1.0 + std::abs(lost)));  // first order at 0.3 ms
  }
}

TEST(Setup, RefusesWhatTheModelLacks) {
  const tiller_model_t& m = *tiller_find_model("pendulum");
  StepSetup setup;
  tiller_config_t config = plain_config(&m);
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
