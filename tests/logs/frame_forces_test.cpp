// Joint forces as a force at a frame, against a two-link arm by hand.
#include "tools/logs/frame_forces.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

constexpr double kUpper_m = 0.4, kLower_m = 0.3;

struct Arm {
  tiller_config_t config{};
  tiller_info_t info{};

  Arm(double shoulder_rad, double elbow_rad) {
    config.model = tiller_find_model("two_link_arm");
    config.posterior.kind = tiller_posterior_filter;
    config.posterior.disturbance = 1;
    info.state_mean[0] = shoulder_rad;
    info.state_mean[1] = elbow_rad;
    info.param_mean[2] = kUpper_m;
    info.param_mean[3] = kLower_m;
    info.force_mean[0] = 0.7;
    info.force_mean[1] = -0.4;
    info.force_sd[0] = 0.05;
    info.force_sd[1] = 0.02;
  }
};

TEST(FrameForces, OfATwoLinkArmAreThoseOfItsTransposedJacobian) {
  for (const double shoulder : {0.3, -1.2, 2.6})
    for (const double elbow : {0.8, -1.5, 2.9}) {
      const Arm arm(shoulder, elbow);
      const FrameForces forces(arm.config);
      ASSERT_EQ(forces.names(), (Words{"tip_x_N", "tip_z_N"}));
      double mean[2], sd[2];
      forces.compute(arm.info, mean, sd);
      // the tip is at (l1 sin q1 + l2 sin q12, -l1 cos q1 - l2 cos q12): its columns by q1 and q2
      const double s1 = std::sin(shoulder), c1 = std::cos(shoulder);
      const double s12 = std::sin(shoulder + elbow), c12 = std::cos(shoulder + elbow);
      const double x1 = kUpper_m * c1 + kLower_m * c12, z1 = kUpper_m * s1 + kLower_m * s12;
      const double x2 = kLower_m * c12, z2 = kLower_m * s12;
      // tau1 = x1 Fx + z1 Fz, tau2 = x2 Fx + z2 Fz by Cramer's rule
      const double det = x1 * z2 - z1 * x2;
      EXPECT_NEAR(det, kUpper_m * kLower_m * std::sin(elbow), 1e-12) << "the formula by hand is right";
      EXPECT_NEAR(mean[0], (z2 * 0.7 - z1 * -0.4) / det, 1e-6 / std::fabs(det));
      EXPECT_NEAR(mean[1], (x1 * -0.4 - x2 * 0.7) / det, 1e-6 / std::fabs(det));
      EXPECT_NEAR(sd[0], std::hypot(z2 * 0.05, z1 * 0.02) / std::fabs(det), 1e-6 / std::fabs(det));
      EXPECT_NEAR(sd[1], std::hypot(x2 * 0.05, x1 * 0.02) / std::fabs(det), 1e-6 / std::fabs(det));
    }
}

TEST(FrameForces, AlongAStretchedArmAreNotDetermined) {
  double mean[2], sd[2];
  // hanging straight down: what pulls along it, z, turns no joint; of x both joints tell
  const Arm hanging(0.0, 0.0);
  FrameForces(hanging.config).compute(hanging.info, mean, sd);
  const double reach = kUpper_m + kLower_m, w1 = 1.0 / (0.05 * 0.05), w2 = 1.0 / (0.02 * 0.02);
  const double weight = w1 * reach * reach + w2 * kLower_m * kLower_m;
  EXPECT_NEAR(mean[0], (w1 * reach * 0.7 + w2 * kLower_m * -0.4) / weight, 1e-6);
  EXPECT_NEAR(sd[0], 1.0 / std::sqrt(weight), 1e-6);
  EXPECT_TRUE(std::isnan(mean[1]) && std::isnan(sd[1]));
  // stretched aslant, what is not felt has a share in both
  const Arm aslant(0.6, 0.0);
  FrameForces(aslant.config).compute(aslant.info, mean, sd);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(std::isnan(mean[i]) && std::isnan(sd[i])) << i;
  // nearly stretched it is determined, but hardly: the deviations say so
  const Arm nearly(0.6, 0.02);
  FrameForces(nearly.config).compute(nearly.info, mean, sd);
  EXPECT_GT(sd[0], 3.0);
}

TEST(FrameForces, AreNoneWithoutForcesOrWithoutAFrame) {
  Arm arm(0.3, 0.8);
  arm.config.posterior.disturbance = 0;
  EXPECT_TRUE(FrameForces(arm.config).names().empty());
  arm.config.posterior.disturbance = 1;
  arm.config.model = tiller_find_model("cart_pole");
  EXPECT_TRUE(FrameForces(arm.config).names().empty());
}

TEST(FrameForces, OfJointForcesThatAreNoneYetAreNotDetermined) {
  Arm arm(0.3, 0.8);
  arm.info.force_sd[1] = 0.0;
  double mean[2], sd[2];
  FrameForces(arm.config).compute(arm.info, mean, sd);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(std::isnan(mean[i]) && std::isnan(sd[i])) << i;
}

}  // namespace
}  // namespace tiller::tools
