// Effects of every port found online by the filter from an encoder alone: a pendulum under random torques, simulated
// four times finer than the filter steps, true values drawn from the prior by fixed seeds.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <random>

#include "linear_rig.hpp"
#include "rollout/late_reading.hpp"
#include "tiller/config.hpp"

namespace {

using tiller::reading_on_path;

struct Case {
  const char* name;
  tiller_effect_kind_t kind;
  std::vector<tiller_prior_t> priors;
  double torque_Nm;                   // amplitude of the random torques
  std::vector<double> least_sharper;  // prior over posterior deviation that 20 s must give, per unknown parameter
};

tiller::Config pendulum_config(const Case& which) {
  tiller::Config c{};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = tiller_find_model("pendulum");
  c.period_s = 0.02;
  c.substeps = 2;
  c.integrator = tiller_integrator_rk4;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.param_count = 3;
  c.priors[0] = rig::uniform(0.45, 0.55);                                  // mass_kg
  c.priors[1] = rig::fixed(0.6);                                           // length_m
  c.priors[2] = rig::fixed(0.05);                                          // damping_Nms
  if (which.kind == tiller_effect_payload) c.priors[0] = rig::fixed(0.5);  // at the bob: only the sum shows
  c.effect_count = 1;
  c.effects[0] = {static_cast<std::uint32_t>(which.kind), 0};
  for (const tiller_prior_t& prior : which.priors) c.priors[c.param_count++] = prior;
  c.measurement_count = 1;
  c.measurement_sd[0] = 0.002;
  c.process_sd[1] = 0.01;
  c.initial_state_sd[0] = 0.1;
  c.initial_state_sd[1] = 0.1;
  c.posterior.enabled = 1;
  c.posterior.particles = 256;
  c.posterior.window = 64;
  c.posterior.moves_per_tick = 8;
  c.posterior.ess_fraction = 0.5;
  c.posterior.noise_scale_shape = 5.0;
  return c;
}

struct Log {
  double params[TILLER_MAX_PARAMS] = {};
  double first = 0.0;
  std::vector<tiller::Transition> transitions;
};

Log simulate(const tiller_config_t& c, double torque_Nm, unsigned seed, int steps,
             std::vector<double>* truth = nullptr) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  std::uniform_real_distribution<double> u01;
  Log log;
  for (std::uint32_t i = 0; i < c.param_count; ++i) {
    const tiller_prior_t& p = c.priors[i];
    log.params[i] = p.kind == tiller_prior_fixed ? p.a : p.low + (0.1 + 0.8 * u01(random)) * (p.high - p.low);
  }
  tiller::StepSetup setup;
  EXPECT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  setup.substeps = 4 * c.substeps;
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  constexpr std::uint32_t kLanes = tiller::kLanePadding;
  double x[2] = {0.05 * n(random), 0.0}, effects[TILLER_MAX_EFFECT_STATES] = {}, out[2 * kLanes];
  double effects_out[TILLER_MAX_EFFECT_STATES * kLanes], torque = 0.0;
  std::vector<double> path(x, x + 2);
  const auto reading = [&] {
    return reading_on_path(c, log.params, 0, path.data(), path.size() / 2 - 1, c.period_s) +
           c.measurement_sd[0] * n(random);
  };
  log.first = reading();
  for (int t = 0; t < steps; ++t) {
    if (t % 12 == 0) torque = torque_Nm * (2.0 * u01(random) - 1.0);
    tiller::RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = kLanes;
    job.horizon = 1;
    job.state = {x, 0};
    job.params = {log.params, 0};
    job.effect_state = {effects, 0};
    job.final_effect_state = effects_out;
    job.controls = {&torque, 0};
    job.final_state = out;
    table.rollout_f64(*c.model, job);
    for (std::uint32_t i = 0; i < 2; ++i) x[i] = out[i * kLanes] + std::sqrt(c.period_s) * c.process_sd[i] * n(random);
    path.insert(path.end(), x, x + 2);
    for (std::uint32_t i = 0; i < setup.effect_state_count; ++i) effects[i] = effects_out[i * kLanes];
    tiller::Transition transition;
    transition.period_s = c.period_s;
    transition.input[0] = torque;
    transition.measured[0] = reading();
    log.transitions.push_back(transition);
  }
  if (truth) *truth = path;
  return log;
}

class Online : public ::testing::TestWithParam<Case> {};

// Four posterior deviations of the truth: of 7 kinds x 3 seeds x up to 4 parameters one in 16,000 falls outside if the
// posterior is right; particles, a coarser step and friction's kinks take some of the margin.
TEST_P(Online, EffectIsFound) {
  const Case& which = GetParam();
  for (unsigned seed = 1; seed <= 3; ++seed) {
    tiller::Config c = pendulum_config(which);
    c.seed = seed;
    const Log log = simulate(c, which.torque_Nm, seed, 1000);
    tiller::StepSetup setup;
    ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
    rig::Instance instance(c, nullptr, tiller::select_rollout(*c.model), &setup);
    tiller::Posterior& p = *instance;
    double before[TILLER_MAX_PARAMS], mean[TILLER_MAX_PARAMS], sd[TILLER_MAX_PARAMS];
    p.moments(mean, before, nullptr, nullptr);
    ASSERT_EQ(p.start(&log.first), tiller_status_ok);
    for (const auto& t : log.transitions) ASSERT_TRUE(rig::works(p.update(t)));
    p.moments(mean, sd, nullptr, nullptr);
    std::size_t unknown = 0;
    for (std::uint32_t i = 3; i < c.param_count; ++i) {
      if (c.priors[i].kind == tiller_prior_fixed) continue;
      std::printf("%s seed %u parameter %u: true %.4f, %.4f +- %.4f (%.1f), sharper %.1f\n", which.name, seed, i,
                  log.params[i], mean[i], sd[i], (mean[i] - log.params[i]) / sd[i], before[i] / sd[i]);
      EXPECT_LT(std::abs(mean[i] - log.params[i]), 4.0 * sd[i]) << "seed " << seed << " parameter " << i;
      EXPECT_GT(before[i] / sd[i], which.least_sharper[unknown++]) << "seed " << seed << " parameter " << i;
    }
    EXPECT_LE(std::abs(mean[0] - log.params[0]), 4.0 * sd[0]) << "seed " << seed << " mass";
  }
}

// A camera that is three and five periods late, and a robot that is pushed: the correction of the speed has the sign
// that a reading of before needs, or the estimate runs away. Errors are those that the filter states.
TEST(SensorDelay, KeepsTheStateOfAPushedRobot) {
  for (const double delay_s : {0.06, 0.1})
    for (const double push : {0.1, 0.5}) {
      const Case late = {"sensor_delay", tiller_effect_sensor_delay, {rig::fixed(delay_s)}, 2.0, {}};
      tiller::Config c = pendulum_config(late);
      c.process_sd[1] = push;
      c.seed = 7;
      std::vector<double> truth;
      const Log log = simulate(c, late.torque_Nm, 7, 1000, &truth);
      tiller::StepSetup setup;
      ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
      rig::Instance instance(c, nullptr, tiller::select_rollout(*c.model), &setup);
      tiller::Posterior& p = *instance;
      ASSERT_EQ(p.start(&log.first), tiller_status_ok);
      double squares[2] = {}, count = 0;
      for (std::size_t t = 0; t < log.transitions.size(); ++t) {
        ASSERT_TRUE(rig::works(p.update(log.transitions[t])));
        double mean[2], sd[2];
        p.moments(nullptr, nullptr, mean, sd);
        if (t < 100) continue;
        for (int i = 0; i < 2; ++i) squares[i] += std::pow((mean[i] - truth[2 * (t + 1) + i]) / sd[i], 2);
        count += 1;
      }
      for (int i = 0; i < 2; ++i) {
        std::printf("delay %.2f s, push %.1f: errors of state %d are %.2f of what is stated\n", delay_s, push, i,
                    std::sqrt(squares[i] / count));
        EXPECT_LT(std::sqrt(squares[i] / count), 2.0);
      }
    }
}

INSTANTIATE_TEST_SUITE_P(Effects, Online,
                         ::testing::Values(
                             // the extra acts only within the Stribeck velocity, and speeds are hardly ever there
                             Case{"stribeck_friction",
                                  tiller_effect_stribeck_friction,
                                  {rig::uniform(0.0, 0.4), rig::uniform(0.0, 0.4), rig::fixed(0.5)},
                                  3.0,
                                  {4.0, 1.5}},
                             Case{"dead_zone", tiller_effect_dead_zone, {rig::uniform(0.0, 0.6)}, 2.0, {4.0}},
                             Case{"cogging",
                                  tiller_effect_cogging,
                                  {rig::uniform(-0.5, 0.5), rig::uniform(-0.5, 0.5), rig::fixed(0.5235987755982988)},
                                  2.0,
                                  {4.0, 4.0}},
                             Case{"sensor_bias", tiller_effect_sensor_bias, {rig::uniform(-0.2, 0.2)}, 2.0, {4.0}},
                             Case{"encoder_eccentricity",
                                  tiller_effect_encoder_eccentricity,
                                  {rig::uniform(-0.1, 0.1), rig::uniform(-0.1, 0.1), rig::fixed(6.283185307179586)},
                                  2.0,
                                  {4.0, 4.0}},
                             Case{"sensor_delay", tiller_effect_sensor_delay, {rig::uniform(0.0, 0.03)}, 2.0, {4.0}},
                             Case{"tilt", tiller_effect_tilt, {rig::uniform(-0.2, 0.2)}, 2.0, {4.0}},
                             Case{"payload", tiller_effect_payload, {rig::uniform(0.0, 0.5)}, 2.0, {2.0}}),
                         [](const auto& each) { return std::string(each.param.name); });

}  // namespace
