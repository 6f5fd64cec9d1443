// Slips that the posterior tells of, in what the executive tells.

#include <gtest/gtest.h>

#include "bench.hpp"

namespace {

TEST(Slips, AreToldByState) {
  bench::Bench b(bench::slipping_base());
  EXPECT_EQ(b.executive->info().slip_states, 7u);
  EXPECT_EQ(b.executive->info().force_joints, 0u);
  fakes::posterior.force[1] = 0.1;
  fakes::posterior.force[2] = -0.05;
  fakes::posterior.force_sd = 0.02;
  (void)b.tick();
  const tiller_info_t& info = b.executive->info();
  const double mean[] = {0.0, 0.1, -0.05};
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(info.slip_mean[i], mean[i]);
    EXPECT_EQ(info.slip_sd[i], 0.02);
  }
  EXPECT_EQ(info.slip_sd[3], 0.0);
}

TEST(Slips, AreNoneOfAModelWithJoints) {
  tiller::Config c = bench::known_pendulum();
  c.posterior.disturbance = 1;
  bench::Bench b(c);
  fakes::posterior.force[0] = 0.1;
  (void)b.tick();
  EXPECT_EQ(b.executive->info().slip_states, 0u);
  EXPECT_EQ(b.executive->info().slip_mean[0], 0.0);
}

}  // namespace
