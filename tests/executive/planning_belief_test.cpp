#include "executive/planning_belief.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

using tiller::Belief;
using tiller::CommandTimeline;
using tiller::PlanningBelief;
using tiller::StepSetup;

/// Explicit integration of the bench's pendulum in double precision at 10 us, with a torque that may depend on time.
template <class Torque>
void integrate(double& angle, double& rate, double time_s, double half, const Torque& torque_Nm) {
  const double step_s = 1e-5;
  const int steps = static_cast<int>(std::lround(time_s / step_s));
  for (int i = 0; i < steps; ++i) {
    const double inertia = half * half * half;
    const double turn = torque_Nm((i + 0.5) * step_s) - half * rate - half * half * 9.81 * std::sin(angle);
    angle += step_s * (rate + 0.5 * step_s * turn / inertia);
    rate += step_s * turn / inertia;
  }
}

struct Source {
  explicit Source(tiller::Config c, bool over_delays = false) : config(c), storage(1 << 16), source_storage(1 << 16) {
    fakes::reset();
    EXPECT_EQ(make_step_setup(config, setup), tiller_status_ok);
    const tiller::RolloutTable& table = tiller::select_rollout(*config.model);
    tiller::Arena arena = storage.arena();
    belief.lay_out(arena, config, setup, table, over_delays);
    timeline.lay_out(arena, config.model->input_count, 1000000);
    tiller::Arena source_arena = source_storage.arena();
    source = tiller::Posterior::lay_out(source_arena, config, setup, table, nullptr);
  }
  void push(std::int64_t at_us, double value) { timeline.push(at_us, &value); }

  tiller::Config config;
  bench::Storage storage, source_storage;
  StepSetup setup;
  PlanningBelief belief;
  CommandTimeline timeline;
  tiller::Posterior* source = nullptr;
};

TEST(PlanningBelief, HasTheForcesThatThePosteriorFound) {
  tiller::Config c = bench::known_pendulum();
  c.posterior.disturbance = 1;
  Source s(c);
  fakes::posterior.force[0] = -0.3;
  fakes::posterior.force_imaginary = 0.2;
  fakes::posterior.viscous = 0.02;
  fakes::posterior.dry = 0.1;
  s.push(0, 0.0);
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
  const StepSetup& setup = s.belief.planner_setup();
  ASSERT_EQ(setup.effect_count, 3u);
  const std::uint32_t kinds[] = {tiller_effect_viscous_friction, tiller_effect_coulomb_friction,
                                 tiller_effect_constant_offset};
  const float values[] = {0.02f, 0.1f, -0.3f};
  const Belief& belief = s.belief.belief();
  for (std::uint32_t k = 0; k < 3; ++k) {
    EXPECT_EQ(setup.effects[k].kind, kinds[k]);
    for (std::uint32_t lane = 0; lane < belief.count; ++lane)
      EXPECT_EQ(belief.params[setup.effects[k].param * belief.count + lane], values[k]) << k;
  }
  EXPECT_EQ(setup.fading, 1u) << "friction stays, what wanders fades";
  EXPECT_EQ(setup.fading_param, setup.effects[2].param);
  const double behind[] = {0.2, 0.5 * c.period_s,
                           1.5 * c.period_s};  // its imaginary part, how fast it fades and swings
  for (std::uint32_t i = 0; i < 3; ++i)
    EXPECT_FLOAT_EQ(belief.params[(setup.fading_param + 1 + i) * belief.count], static_cast<float>(behind[i]));
}

TEST(PlanningBelief, SpreadHasHowFarTheForcesMayBeOffWhereSomebodyAsks) {
  tiller::Config c = bench::known_pendulum();
  c.posterior.disturbance = 1;
  for (const double risk : {0.0, 0.05}) {
    c.cost.bound_risk = risk;
    Source s(c);
    fakes::posterior.force[0] = -0.3;
    fakes::posterior.force_sd = 0.4;
    s.push(0, 0.0);
    s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
    const Belief& belief = s.belief.belief();
    const std::uint32_t row = s.belief.planner_setup().fading_param;
    for (std::uint32_t lane = 0; lane < belief.count; ++lane)
      EXPECT_EQ(belief.params[row * belief.count + lane], -0.3f) << "plans are over the mean, asked or not";
    ASSERT_EQ(belief.spread != nullptr, risk > 0.0);
    if (!belief.spread) continue;
    EXPECT_EQ(belief.spread->forces, 1u);
    EXPECT_EQ(belief.spread->force_sd[0], 0.4);
    EXPECT_DOUBLE_EQ(belief.spread->force_size[0], 0.5) << "its mean square";
    EXPECT_DOUBLE_EQ(belief.spread->force_kept, std::exp(-0.5 * c.period_s));
  }
}

TEST(PlanningBelief, HasTheSlipsOfAModelWithoutJoints) {
  tiller::Config c = bench::slipping_base();
  c.cost.bound_risk = 0.05;
  Source s(c);
  const double slips[] = {0.02, 0.1, -0.05}, stop[] = {0.0, 0.0};
  std::copy(std::begin(slips), std::end(slips), fakes::posterior.force);
  fakes::posterior.force_sd = 0.4;
  fakes::posterior.param[0] = fakes::posterior.param[1] = 0.1;
  s.timeline.push(0, stop);
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 3.0 * c.period_s);
  const StepSetup& setup = s.belief.planner_setup();
  EXPECT_EQ(setup.effect_count, 0u);
  EXPECT_EQ(setup.slip_states, 7u);
  EXPECT_EQ(setup.fading, 3u);
  EXPECT_EQ(setup.fading_param, c.param_count);
  const Belief& belief = s.belief.belief();
  for (std::uint32_t lane = 0; lane < belief.count; ++lane)
    for (std::uint32_t i = 0; i < 3; ++i) {
      EXPECT_EQ(belief.params[(setup.fading_param + i) * belief.count + lane], static_cast<float>(slips[i]));
      EXPECT_NEAR(belief.state[i * belief.count + lane], 3.0 * c.period_s * slips[i], 1e-6) << "as it stands there";
    }
  EXPECT_FLOAT_EQ(belief.params[(setup.fading_param + 6) * belief.count], static_cast<float>(0.5 * c.period_s));
  EXPECT_EQ(belief.spread->forces, 3u);
  EXPECT_EQ(belief.spread->force_sd[2], 0.4);
}

TEST(PlanningBelief, StepsUnderTheCommandsAlreadySent) {
  Source s(bench::known_pendulum());
  s.push(0, 1.0);
  s.push(1000000 + 8000, -2.0);
  fakes::posterior.state[0] = 0.4;
  fakes::posterior.state[1] = 2.0;
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
  EXPECT_EQ(s.belief.belief().state[0], 0.4f);

  // 30 ms: more than a period, and a command changes on the way
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.03);
  double angle = 0.4, rate = 2.0;
  integrate(angle, rate, 0.03, 0.5, [](double t) { return t < 0.008 ? 1.0 : -2.0; });
  const Belief& b = s.belief.belief();
  ASSERT_EQ(b.count, 3u);
  for (std::uint32_t i = 0; i < b.count; ++i) {
    // the command is averaged within a step of 20 ms: its moment about the step's middle is what the angle loses,
    // (1 - 0.4 - 0.5) 20 ms * 3 Nm / 0.125 kg m2 * 0.4 * 20 ms / 2 or so
    EXPECT_NEAR(b.state[i], angle, 3e-3);
    EXPECT_NEAR(b.state[b.count + i], rate, 2e-2);
  }
}

TEST(PlanningBelief, EachHypothesisHasItsOwnDelay) {
  tiller::Config config = bench::known_pendulum();
  config.effect_count = 1;
  config.effects[0] = {tiller_effect_input_delay, 0};
  config.param_count = 4;
  config.priors[3] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.06};
  Source s(config);
  ASSERT_EQ(s.setup.delay_steps, 3u);
  // a step from 0 to 3 Nm, 15 ms before the stamp; delays 0, 20 and 40 ms
  s.push(0, 0.0);
  s.push(1000000 - 15000, 3.0);
  fakes::posterior.param[3] = 0.0;
  fakes::posterior.param_step = 0.0f;
  const double delays_s[] = {0.0, 0.01, 0.02};
  for (double delay_s : delays_s) {
    fakes::posterior.param[3] = delay_s;
    s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.01);
    double angle = 0.0, rate = 0.0;
    integrate(angle, rate, 0.01, 0.5, [&](double t) { return t - delay_s >= -0.015 ? 3.0 : 0.0; });
    // within a single step the mean command is right for the rate to first order
    EXPECT_NEAR(s.belief.belief().state[3], rate, 5e-3) << "delay " << delay_s;
  }
  // history on the grid of the period, ending where the first planned command begins
  const float* history = s.belief.belief().history;
  EXPECT_FLOAT_EQ(history[0], 3.0f);
  EXPECT_NEAR(history[1], 3.0 * 5.0 / 20.0, 1e-6) << "from 10 to 30 ms back: 3 Nm for 5 of 20 ms";
  EXPECT_EQ(history[2], 0.0f);
}

TEST(PlanningBelief, GoesOverPartsOfPeriodsThatThePosteriorFound) {
  Source s(bench::known_pendulum(), true);
  s.push(1000000 - 40000, 2.0);
  s.push(1000000 - 20000, -1.0);
  s.push(1000000, 3.0);
  fakes::posterior.state[0] = 0.4;
  fakes::posterior.state[1] = 1.0;
  fakes::posterior.delay = {0.0, 0.5, 1.3};
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
  const Belief& b = s.belief.belief();
  ASSERT_EQ(b.count, 3u);
  for (std::uint32_t i = 0; i < b.count; ++i) {
    // up to where the command of the stamp begins to act
    const double late_s = fakes::posterior.delay[i] * s.config.period_s;
    double angle = 0.4, rate = 1.0;
    integrate(angle, rate, late_s, 0.5, [&](double t) { return t - late_s < -0.02 ? 2.0 : -1.0; });
    EXPECT_NEAR(b.state[i], angle, 1e-4) << i;
    EXPECT_NEAR(b.state[b.count + i], rate, 1e-3) << i;
  }
}

TEST(PlanningBelief, HypothesesDifferByTheirParameters) {
  Source s(bench::known_pendulum());
  fakes::posterior.param_step = 0.1f;
  fakes::posterior.state[0] = 1.0;
  s.push(0, 0.0);
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.02);
  const Belief& b = s.belief.belief();
  for (std::uint32_t i = 0; i < 3; ++i) {
    double angle = 1.0, rate = 0.0;
    const double half = 0.5 + 0.1 * i;
    integrate(angle, rate, 0.02, half, [](double) { return 0.0; });
    EXPECT_NEAR(b.state[3 + i], rate, 1e-4) << i;
  }
}

/// A pendulum with an input delay of up to 60 ms, 20 ms periods.
tiller::Config delayed_pendulum(std::uint32_t particles) {
  tiller::Config config = bench::known_pendulum();
  config.planner.particles = particles;
  config.effect_count = 1;
  config.effects[0] = {tiller_effect_input_delay, 0};
  config.param_count = 4;
  config.priors[3] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.06};
  return config;
}

/// The same steps in double, one hypothesis by itself: a part of a period, then whole ones, each under one command.
void step_exactly(const tiller_config_t& config, const float* params, double torque_Nm, double time_s, double* x) {
  StepSetup setup;
  ASSERT_EQ(make_step_setup(config, setup), tiller_status_ok);
  setup.effect_count = setup.delay_steps = 0;
  double p[4], next[2 * tiller::kLanePadding];
  for (int i = 0; i < 4; ++i) p[i] = static_cast<double>(params[i]);
  tiller::RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = tiller::kLanePadding;
  job.horizon = 1;
  job.period_s = time_s;
  job.state = {x, 0};
  job.params = {p, 0};
  job.controls = {&torque_Nm, 0};
  job.final_state = next;
  tiller::select_rollout(*config.model).rollout_f64(*config.model, job);
  x[0] = next[0];
  x[1] = next[tiller::kLanePadding];
}

TEST(PlanningBeliefOverDelays, GoesOnUntilTheFirstCommandActs) {
  const double commands_Nm[] = {2.0, -3.0, 5.0, 1.0};  // the last one was sent a period ago
  double worst = 0.0;
  for (const double periods : {0.0, 1.0, 2.5}) {
    Source s(delayed_pendulum(3), true);
    for (int k = 0; k < 4; ++k) s.push(1000000 - 20000 * (4 - k), commands_Nm[k]);
    fakes::posterior.param[3] = 0.02 * periods;
    fakes::posterior.state[0] = 0.4;
    fakes::posterior.state[1] = 2.0;
    s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
    const Belief& b = s.belief.belief();
    EXPECT_EQ(b.history, nullptr);
    EXPECT_EQ(s.belief.planner_setup().effect_count, 0u);
    EXPECT_EQ(s.belief.planner_setup().delay_steps, 0u);
    EXPECT_EQ(s.belief.lead_periods(), static_cast<std::uint32_t>(periods + 0.5));
    const float params[] = {0.5f, 0.5f, 0.5f, 0.0f};
    double x[2] = {static_cast<double>(0.4f), 2.0}, angle = 0.4, rate = 2.0;
    const int whole = static_cast<int>(periods);
    const double part_s = 0.02 * (periods - whole);
    if (part_s > 0.0) step_exactly(s.config, params, commands_Nm[3 - whole], part_s, x);
    for (int k = whole; k > 0; --k) step_exactly(s.config, params, commands_Nm[4 - k], 0.02, x);
    integrate(angle, rate, 0.02 * periods, 0.5, [&](double t) {
      const int back = static_cast<int>(std::ceil(periods - t / 0.02));
      return commands_Nm[4 - back];
    });
    for (std::uint32_t i = 0; i < 3; ++i) {
      // three steps of RK4 in float: some ten roundings of 6e-8 at a size of two
      EXPECT_NEAR(b.state[i], x[0], 2e-6) << periods;
      EXPECT_NEAR(b.state[3 + i], x[1], 2e-6) << periods;
      worst = std::max({worst, std::fabs(static_cast<double>(b.state[i]) - x[0]),
                        std::fabs(static_cast<double>(b.state[3 + i]) - x[1])});
      // and that is the motion: 10 us steps of first order in the rate are good for 1e-4
      EXPECT_NEAR(b.state[i], angle, 2e-4) << periods;
      EXPECT_NEAR(b.state[3 + i], rate, 2e-4) << periods;
    }
  }
  std::printf("largest difference from the same steps in double: %.1e\n", worst);
}

TEST(PlanningBeliefOverDelays, EachHypothesisByItsOwnDelay) {
  // 20 hypotheses, two registers: delays 0, 3, .. 57 ms, and with them masses and lengths
  Source s(delayed_pendulum(20), true);
  for (int k = 0; k < 4; ++k) s.push(1000000 - 20000 * (4 - k), 3.0 * (k % 2 ? -1.0 : 1.0));
  fakes::posterior.param[3] = 0.0;
  fakes::posterior.param_step = 0.003f;
  fakes::posterior.state[0] = -0.7;
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.004);
  const Belief& b = s.belief.belief();
  for (std::uint32_t i = 0; i < 20; ++i) {
    const float grown = 0.5f + 0.003f * static_cast<float>(i);
    const double delay_s = static_cast<double>(0.003f * static_cast<float>(i)), half = static_cast<double>(grown);
    double angle = -0.7, rate = 0.0;
    // sent at -80, -60, -40 and -20 ms: acting as much later as the delay
    integrate(angle, rate, 0.004 + delay_s, half, [&](double t) {
      const double sent = t - delay_s;
      const int k = sent >= -0.02 ? 3 : sent >= -0.04 ? 2 : sent >= -0.06 ? 1 : 0;
      return 3.0 * (k % 2 ? -1.0 : 1.0);
    });
    // ahead of the whole periods stands a part whose command is a mean where it changes within: of 6 Nm, 4 ms by at
    // most 16 ms, over 0.125 kg m2, in the angle
    EXPECT_NEAR(b.state[i], angle, 1.6e-3) << i;
    EXPECT_NEAR(b.state[20 + i], rate, 5e-2) << i;
  }
}

TEST(PlanningBeliefOverDelays, DelaysThatAreNoNumbersAreNone) {
  Source s(delayed_pendulum(3), true);
  s.push(0, 1.0);
  fakes::posterior.param[3] = std::nan("");
  fakes::posterior.state[0] = 0.4;
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
  EXPECT_EQ(s.belief.belief().state[0], 0.4f);
  fakes::posterior.param[3] = 1e30;  // as far as the setup provides for
  s.belief.draw(*s.source, s.timeline, 0, 1000000, 0.0);
  EXPECT_EQ(s.belief.lead_periods(), 4u);
}

}  // namespace
