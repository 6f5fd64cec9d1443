#include "executive/motion_check.hpp"

#include <gtest/gtest.h>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

class Motion : public ::testing::Test {
 protected:
  explicit Motion(const tiller::Config& config = bench::known_pendulum())
      : config_(config), storage_(1 << 16), source_storage_(1 << 16) {
    fakes::reset();
    (void)make_step_setup(config_, setup_);
    const tiller::RolloutTable& table = tiller::select_rollout(*config_.model);
    tiller::Arena arena = storage_.arena();
    forces_ = tiller::PlannedForces(config_, setup_);
    motion_.lay_out(arena, config_, forces_, table);
    tiller::Arena source_arena = source_storage_.arena();
    source_ = tiller::Posterior::lay_out(source_arena, config_, setup_, table, nullptr);
  }
  bool moves(double angle, double rate_sd, double torque_Nm, int steps) {
    const double mean[] = {angle, 0.0}, sd[] = {0.0, rate_sd};
    return moves(mean, sd, &torque_Nm, steps);
  }
  bool moves(const double* mean, const double* sd, const double* input, int steps) {
    motion_.begin(*source_, 1, mean, sd);
    for (int i = 0; i < steps; ++i) motion_.step(config_.period_s, input, nullptr);
    EXPECT_EQ(motion_.steps(), static_cast<std::uint32_t>(steps));
    return motion_.should_move();
  }
  tiller::Config config_;
  bench::Storage storage_, source_storage_;
  tiller::StepSetup setup_;
  tiller::PlannedForces forces_;
  tiller::MotionCheck motion_;
  tiller::Posterior* source_ = nullptr;
};

TEST_F(Motion, NothingIsExpectedBeforeItBegins) { EXPECT_FALSE(motion_.should_move()); }

TEST_F(Motion, TorqueMoves) { EXPECT_TRUE(moves(0.0, 0.0, 0.5, 10)); }

TEST_F(Motion, RestRests) {
  EXPECT_FALSE(moves(0.0, 0.0, 0.0, 100));
  // held at 0.3 rad by the torque that balances gravity: 0.25 kg m * 9.81 * sin 0.3
  EXPECT_FALSE(moves(0.3, 0.0, 0.25 * 9.81 * 0.29552020666, 100));
}

TEST_F(Motion, TooLittleToSeeIsNoMotion) {
  // the sensor's noise is 1 mrad; this torque leans the pendulum by 2.4 mrad, below six deviations
  EXPECT_FALSE(moves(0.0, 0.0, 0.006, 25));
}

tiller::Config pushed_pendulum() {
  tiller::Config c = bench::known_pendulum();
  c.posterior.disturbance = 1;
  return c;
}

class PushedMotion : public Motion {
 protected:
  PushedMotion() : Motion(pushed_pendulum()) {}
};

/// Half a newton metre that a force beyond the model takes up is no motion: nor is it where that force is in doubt.
TEST_F(PushedMotion, AForceThatHoldsIsNoDeadSensor) {
  EXPECT_TRUE(moves(0.0, 0.0, 0.5, 10));
  fakes::posterior.force[0] = -0.5;
  EXPECT_FALSE(moves(0.0, 0.0, 0.5, 10));
  fakes::posterior.force[0] = -0.3;
  EXPECT_TRUE(moves(0.0, 0.0, 0.5, 10));
  fakes::posterior.force_sd = 0.1;
  EXPECT_FALSE(moves(0.0, 0.0, 0.5, 10));
  fakes::posterior.force[0] = fakes::posterior.force_sd = 0.0;
  fakes::posterior.dry = 0.6;
  EXPECT_FALSE(moves(0.0, 0.0, 0.5, 10)) << "friction holds as well";
}

/// Whatever the force may be off by, the first hypothesis is what is expected of it.
TEST_F(PushedMotion, AForceThatIsExpectedToHoldHoldsHoweverUnsureItIs) {
  fakes::posterior.force[0] = -0.5;
  for (const double sd : {0.3, 1.0, 3.0}) {
    fakes::posterior.force_sd = sd;
    EXPECT_FALSE(moves(0.0, 0.0, 0.5, 10)) << sd;
  }
}

class SlippingMotion : public Motion {
 protected:
  SlippingMotion() : Motion(bench::slipping_base()) {
    fakes::posterior.param[0] = fakes::posterior.param[1] = 0.1;
    fakes::posterior.param[2] = 0.0;
  }
  bool moves(double wheels_rad_s) {
    const double mean[] = {0.0, 0.0, 0.0}, input[] = {wheels_rad_s, wheels_rad_s};
    return Motion::moves(mean, mean, input, 10);
  }
};

/// Half a second at 0.1 m/s. What stands against a wall slips as fast as its wheels turn.
TEST_F(SlippingMotion, ABaseAtAWallIsNoDeadSensor) {
  EXPECT_TRUE(moves(1.0));
  fakes::posterior.force[0] = -0.1;
  EXPECT_FALSE(moves(1.0));
  fakes::posterior.force[0] = -0.05;
  EXPECT_TRUE(moves(1.0));
}

TEST_F(SlippingMotion, NorIsOneThatStopsOnASlope) {
  fakes::posterior.force[1] = -0.1;
  EXPECT_FALSE(moves(0.0)) << "a slip may end with the motion";
  EXPECT_TRUE(moves(1.0));
}

TEST_F(Motion, DoubtAboutTheRateIsDoubtAboutTheMotion) {
  // 0.1 Nm moves it by 12 sensor deviations in 0.2 s, a rate of -0.09 rad/s that it may have had takes that back
  EXPECT_TRUE(moves(0.0, 0.0, 0.1, 10));
  EXPECT_FALSE(moves(0.0, 0.06, 0.1, 10));
}

}  // namespace
