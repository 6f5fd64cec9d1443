// What an alarm of the adequacy test makes of a posterior that learns again: also when it came in a bad moment.

#include "driven_pendulum_rig.hpp"

namespace {

constexpr unsigned kSeeds = 6;

tiller::Config pendulum() {
  tiller::Config c = rig::DrivenPendulum::config(rig::uniform(0.2, 0.8));
  c.posterior.adequacy = c.posterior.relearn = 1;
  c.posterior.window = 128;
  return c;
}

/// How far off the mass is at the end, as a share of it.
double mass_off(const rig::DrivenPendulum& world, unsigned seed) {
  double off = INFINITY;
  tiller::PosteriorReport report;
  world.run(pendulum(), seed, [&](const tiller::Posterior& posterior, int k, double mass_kg) {
    if (k < world.steps) return;
    posterior.report(report);
    double mean[TILLER_MAX_PARAMS], sd[TILLER_MAX_PARAMS], state[TILLER_MAX_STATES], state_sd[TILLER_MAX_STATES];
    posterior.moments(mean, sd, state, state_sd);
    off = std::fabs(mean[0] / mass_kg - 1.0);
  });
  EXPECT_GT(report.relearned, 0u) << seed;
  return off;
}

TEST(Relearn, FindsAMassThatHasChanged) {
  rig::DrivenPendulum world;
  world.most_kg = 0.55;
  world.steps = 1500;
  world.share = [](double t) { return t < 10.0 ? 1.0 : 1.3; };
  for (unsigned seed = 1; seed <= kSeeds; ++seed) EXPECT_LT(mass_off(world, seed), 0.01) << seed;
}

/// A push of four seconds, which no parameter explains. Relearning but once leaves the mass 2 to 8 % off in 13 of 20.
TEST(Relearn, DoesNotBelieveForEverWhatItLearntWhileSomebodyPushed) {
  rig::DrivenPendulum world;
  world.steps = 2000;
  world.force_Nm = [](double t) { return t > 10.0 && t < 14.0 ? 0.5 : 0.0; };
  for (unsigned seed = 1; seed <= kSeeds; ++seed) EXPECT_LT(mass_off(world, seed), 0.01) << seed;
}

}  // namespace
