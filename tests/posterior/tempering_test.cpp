// The exponent on the likelihood: when it falls, when it may rise, and when a cloud is resampled instead.

#include "posterior/tempering.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "linear_rig.hpp"

namespace {

using tiller::Tempering;

/// A cloud whose likelihood favours the first particles: `steepness` nats a particle.
struct Scene {
  tiller::Config config = rig::config();
  std::vector<unsigned char> block;
  tiller::Cloud cloud;
  std::vector<double> base, gain;
  Tempering tempering;

  explicit Scene(double steepness) {
    config.posterior.particles = 64;
    config.posterior.moves_per_tick = 8;
    config.posterior.ess_fraction = 0.5;
    tiller::Arena measure;
    (void)tiller::Cloud::lay_out(measure, config);
    block.resize(measure.used() + tiller::Arena::kAlignment);
    void* at = block.data();
    std::size_t space = block.size();
    std::align(tiller::Arena::kAlignment, measure.used(), at, space);
    tiller::Arena arena(at, measure.used());
    cloud = tiller::Cloud::lay_out(arena, config);
    cloud.draw_prior();
    for (std::uint32_t i = 0; i < cloud.n; ++i) gain.push_back(-steepness * i);
    base.assign(cloud.n, 0.0);
  }
  /// True: to be resampled.
  bool tick() {
    const Tempering::Choice choice = tempering.choose(cloud, base.data(), gain.data(), {});
    cloud.set_weights(base.data(), gain.data(), choice.exponent);
    return tempering.take(cloud, choice, false);
  }
  void sweep() { tempering.note_moves(cloud, cloud.n, cloud.n / 2); }
};

TEST(Tempering, DataThatTellLittleCountInFull) {
  Scene s(0.01);
  EXPECT_FALSE(s.tick());
  EXPECT_EQ(s.tempering.exponent(), 1.0);
}

TEST(Tempering, TheExponentFallsToWhereEnoughParticlesAreLeft) {
  Scene s(1.0);
  EXPECT_TRUE(s.tick());
  EXPECT_LT(s.tempering.exponent(), 1.0);
  EXPECT_GE(s.cloud.effective_samples, 32.0);
}

TEST(Tempering, ItRisesOnlyAfterASweep) {
  Scene s(1.0);
  s.tick();
  const double fallen = s.tempering.exponent();
  s.gain.assign(s.cloud.n, 0.0);  // nothing holds it back any more
  s.tempering.note_moves(s.cloud, 56, 0);
  s.tick();
  EXPECT_EQ(s.tempering.exponent(), fallen);
  s.tempering.note_moves(s.cloud, 8, 0);
  s.tick();
  EXPECT_EQ(s.tempering.exponent(), 1.0);
}

TEST(Tempering, ASettledCloudIsResampledInsteadDownToHalfOfTheFloor) {
  Scene s(0.08);
  s.sweep();
  ASSERT_TRUE(s.tempering.settled(s.cloud));
  EXPECT_TRUE(s.tick());
  EXPECT_LT(s.cloud.effective_samples, 32.0);
  EXPECT_GE(s.cloud.effective_samples, 16.0);
  EXPECT_EQ(s.tempering.exponent(), 1.0);
  s.tempering.note_resampling();
  EXPECT_FALSE(s.tempering.settled(s.cloud));
  EXPECT_EQ(s.tempering.resamplings(), 1u);
}

TEST(Tempering, TheNextToMoveFollowThoseThatHaveMoved) {
  Scene s(0.0);
  s.tempering.note_moves(s.cloud, 40, 40);
  s.tempering.note_moves(s.cloud, 40, 0);
  EXPECT_EQ(s.tempering.cursor(), 16u);
  EXPECT_TRUE(s.tempering.swept(s.cloud));
  EXPECT_NEAR(s.tempering.acceptance(), 0.05 * 0.95, 1e-12);
}

}  // namespace
