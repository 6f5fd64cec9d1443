// Friction that a pendulum's model lacks, followed by the forces that are estimated beside it: the alarm says so, and
// says nothing of pushes that are no friction.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "linear_rig.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace {

constexpr double kLength_m = 0.5, kGravity_m_s2 = 9.81, kPeriod_s = 0.02, kDamping_Nms = 0.02, kSeconds = 15.0;
constexpr unsigned kSeeds = 6, kStillSeeds = 12;

/// The damping is known, so that a further viscous friction is a force and no parameter.
tiller::Config pendulum(bool relearn = false) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
  c.period_s = kPeriod_s;
  c.priors[0] = rig::uniform(0.25, 0.75);
  c.priors[1] = rig::fixed(kLength_m);
  c.priors[2] = rig::fixed(kDamping_Nms);
  c.measurement_sd[0] = 0.002;
  c.process_sd[1] = 0.02;
  c.initial_state_sd[0] = c.initial_state_sd[1] = 0.01;
  c.safety.input_low[0] = -1.5;
  c.safety.input_high[0] = 1.5;
  c.posterior.disturbance = 1;
  c.posterior.adequacy = 1;
  c.posterior.relearn = relearn ? 1 : 0;
  c.posterior.window = 128;
  c.posterior.moves_per_tick = 16;
  return c;
}

struct World {
  double dry_Nm = 0.0, viscous_Nms = 0.0;
  std::function<double(double time_s)> push = [](double) { return 0.0; };
};

World constant(unsigned seed) {
  World w;
  w.push = [seed](double) { return seed % 2 ? 0.7 : -0.7; };
  return w;
}

/// Ornstein and Uhlenbeck's, of 0.2 N m and 1 s, drawn every 10 ms and held.
World gusts(unsigned seed) {
  std::mt19937_64 random(1000 + seed);
  std::normal_distribution<double> n;
  std::vector<double> drawn = {n(random)};
  const double keep = std::exp(-0.01);
  while (drawn.size() < static_cast<std::size_t>(110.0 * kSeconds))
    drawn.push_back(keep * drawn.back() + std::sqrt(1.0 - keep * keep) * n(random));
  World w;
  w.push = [drawn](double t) { return 0.2 * drawn[static_cast<std::size_t>(100.0 * t)]; };
  return w;
}

struct Outcome {
  double alarm_s = -1.0;
  tiller_feature_t feature = tiller_feature_none;
  std::uint32_t channel = 99;
  tiller::Posterior::Friction friction;
  tiller::PosteriorReport report;
};

/// A pendulum with equations of its own (Euler and Cromer, 0.1 ms; where dry friction is the stronger, it stands) under
/// a torque of three lines.
Outcome swing(const World& world, unsigned seed, const tiller::Config& c = pendulum()) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  std::uniform_real_distribution<double> u01;
  const double mass = 0.3 + 0.4 * u01(random), inertia = mass * kLength_m * kLength_m, step_s = 1e-4;
  double phase[3];
  for (double& p : phase) p = 6.283 * u01(random);
  double angle = 0.01 * n(random), rate = 0.01 * n(random);

  tiller::StepSetup setup;
  EXPECT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  rig::Instance posterior(c, nullptr, tiller::select_rollout(*c.model), &setup);
  const double first = angle + 0.002 * n(random);
  EXPECT_EQ(posterior->start(&first), tiller_status_ok);
  Outcome out;
  for (int k = 0; k < kSeconds / kPeriod_s; ++k) {
    const double t = k * kPeriod_s;
    double torque = 0.0;
    for (int i = 0; i < 3; ++i) torque += 0.4 * std::sin((1.3 + 2.1 * i) * t + phase[i]);
    for (int i = 0; i < 200; ++i) {
      const double push = torque + world.push(t + step_s * i) - (kDamping_Nms + world.viscous_Nms) * rate -
                          mass * kGravity_m_s2 * kLength_m * std::sin(angle);
      const double free = rate + step_s * push / inertia, held = step_s * world.dry_Nm / inertia;
      rate = std::fabs(free) < held ? 0.0 : free - std::copysign(held, free);
      angle += step_s * rate;
    }
    tiller::Transition transition;
    transition.period_s = kPeriod_s;
    transition.input[0] = torque;
    transition.measured[0] = angle + 0.002 * n(random);
    EXPECT_TRUE(rig::works(posterior->update(transition)));
    if (out.alarm_s >= 0.0 || posterior->adequacy()->state() != tiller_adequacy_inadequate) continue;
    out.alarm_s = t;
    out.feature = posterior->adequacy()->feature();
    out.channel = posterior->adequacy()->channel();
  }
  out.friction = posterior->friction();
  posterior->report(out.report);
  return out;
}

void tell(const char* what, unsigned seed, const Outcome& o) {
  std::printf("%s, seed %u: dry %.4f +- %.4f N m, viscous %.4f +- %.4f N m s; ", what, seed, o.friction.dry[0],
              o.friction.dry_sd[0], o.friction.viscous[0], o.friction.viscous_sd[0]);
  if (o.alarm_s < 0.0)
    std::printf("no alarm\n");
  else
    std::printf("%s after %.1f s\n", tiller_feature_name(o.feature), o.alarm_s);
}

TEST(FrictionAlarm, SoundsForDryFriction) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    World w;
    w.dry_Nm = 0.15;
    const Outcome o = swing(w, seed);
    tell("dry", seed, o);
    EXPECT_GE(o.alarm_s, 0.0) << seed;
    EXPECT_EQ(o.feature, tiller_feature_velocity_sign) << seed;
    EXPECT_EQ(o.channel, 0u) << seed;
    EXPECT_NEAR(o.friction.dry[0], w.dry_Nm, 4.0 * o.friction.dry_sd[0]) << seed;
    EXPECT_LT(o.friction.dry_sd[0], 0.1 * w.dry_Nm) << seed;
  }
}

TEST(FrictionAlarm, SoundsForDrag) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    World w;
    w.viscous_Nms = 0.05;
    const Outcome o = swing(w, seed);
    tell("drag", seed, o);
    EXPECT_GE(o.alarm_s, 0.0) << seed;
    EXPECT_EQ(o.feature, tiller_feature_velocity) << seed;
    EXPECT_EQ(o.channel, 0u) << seed;
    EXPECT_NEAR(o.friction.viscous[0], w.viscous_Nms, 4.0 * o.friction.viscous_sd[0]) << seed;
    EXPECT_LT(o.friction.viscous_sd[0], 0.2 * w.viscous_Nms) << seed;
  }
}

/// Gusts may give the innovations' own alarm, which names none of these.
TEST(FrictionAlarm, IsSilentWherePushesAreNoFriction) {
  for (unsigned seed = 1; seed <= kStillSeeds; ++seed) {
    const struct {
      const char* name;
      World world;
    } cases[] = {{"still", {}}, {"constant", constant(seed)}, {"gusts", gusts(seed)}};
    for (const auto& c : cases) {
      const Outcome o = swing(c.world, seed);
      tell(c.name, seed, o);
      EXPECT_NE(o.feature, tiller_feature_velocity) << c.name << ", seed " << seed;
      EXPECT_NE(o.feature, tiller_feature_velocity_sign) << c.name << ", seed " << seed;
      if (c.name != std::string("gusts")) {
        EXPECT_LT(o.alarm_s, 0.0) << c.name << ", seed " << seed;
      }
    }
  }
}

/// The friction is followed: nothing has changed that would have to be learnt again.
TEST(FrictionAlarm, IsNoReasonToLearnAgain) {
  World w;
  w.dry_Nm = 0.15;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Outcome o = swing(w, seed, pendulum(true));
    EXPECT_EQ(o.feature, tiller_feature_velocity_sign) << seed;
    EXPECT_EQ(o.report.relearned, 0u) << seed;
  }
}

/// A damping that is learnt explains a viscous friction; a mass that is learnt does not, though it divides one.
TEST(FrictionAlarm, LooksForNoFrictionThatTheModelLearns) {
  tiller::Config learnt = pendulum();
  learnt.priors[2] = rig::uniform(0.0, 0.1);
  const Outcome with = swing({}, 1, learnt), without = swing({}, 1);
  EXPECT_EQ(with.friction.viscous_sd[0], 0.0);
  EXPECT_GT(without.friction.viscous_sd[0], 0.0);
}

}  // namespace
