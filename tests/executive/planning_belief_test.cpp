#include "executive/planning_belief.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"

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
  explicit Source(tiller_config_t c) : config(c), storage(1 << 16), source_storage(1 << 16) {
    fakes::reset();
    EXPECT_EQ(make_step_setup(config, setup), tiller_status_ok);
    const tiller::RolloutTable& table = tiller::select_rollout(*config.model);
    tiller::Arena arena = storage.arena();
    belief.lay_out(arena, config, setup, table);
    timeline.lay_out(arena, 1);
    tiller::Arena source_arena = source_storage.arena();
    source = tiller::Posterior::lay_out(source_arena, config, setup, table, nullptr);
  }
  void push(std::int64_t at_us, double value) { timeline.push(at_us, &value); }

  tiller_config_t config;
  bench::Storage storage, source_storage;
  StepSetup setup;
  PlanningBelief belief;
  CommandTimeline timeline;
  tiller::Posterior* source = nullptr;
};

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
  tiller_config_t config = bench::known_pendulum();
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

}  // namespace
