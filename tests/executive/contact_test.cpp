// A force that the model does not contain: HOLD while it lasts, or SAFE.
#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

using bench::Bench;

tiller::Config watched_pendulum(double force_Nm = 0.5) {
  tiller::Config c = bench::known_pendulum();
  c.posterior.disturbance = 1;
  c.safety.contact_force[1] = force_Nm;
  return c;
}

TEST(Contact, IsHoldWhileItLasts) {
  Bench b(watched_pendulum());
  b.activate();
  fakes::planner.command[0] = 9.0;
  fakes::posterior.force[0] = -0.5;
  EXPECT_EQ(b.tick(), tiller_status_ok) << "at the limit, not beyond it";
  fakes::posterior.force[0] = -0.6;
  EXPECT_EQ(b.tick(), tiller_status_contact);
  EXPECT_EQ(b.state(), tiller_state_hold);
  EXPECT_DOUBLE_EQ(b.command.value[0], -2.0 * 0.1) << "HOLD's feedback, not the plan";
  EXPECT_EQ(b.executive->info().touched, 1u);
  EXPECT_EQ(b.executive->info().force_mean[0], -0.6);
  fakes::posterior.force[0] = -0.3;
  EXPECT_EQ(b.tick(), tiller_status_contact) << "until it is half of the limit";
  fakes::posterior.force[0] = -0.2;
  EXPECT_EQ(b.tick(), tiller_status_ok);
  EXPECT_EQ(b.state(), tiller_state_active);
  EXPECT_EQ(b.command.value[0], 9.0);
  EXPECT_EQ(b.executive->info().plan_failures, 0u) << "the plans were good";
}

TEST(Contact, IsWaitedForWithWhatHoldsTheTarget) {
  tiller::Config c = watched_pendulum();
  c.cost.input_reference = tiller_input_reference_steady;
  c.cost.target[0] = 0.8;
  c.cost.state_weight[0] = 1.0;
  Bench b(c);
  b.activate();
  for (int k = 0; k < 20; ++k) (void)b.tick();
  fakes::posterior.force[0] = -0.9;
  for (int k = 0; k < 20; ++k) EXPECT_EQ(b.tick(), tiller_status_contact);
  // against gravity, 0.25 kg m times 9.81 m/s^2, not against the hand
  EXPECT_NEAR(b.command.value[0], 0.25 * 9.81 * std::sin(0.8) - 2.0 * (0.1 - 0.8), 1e-3);
}

TEST(Contact, IsNoneThatTheEstimateIsNotSureOf) {
  Bench b(watched_pendulum());
  b.activate();
  fakes::posterior.force[0] = 0.8;
  fakes::posterior.force_sd = 0.2;
  EXPECT_EQ(b.tick(), tiller_status_ok) << "four deviations from none";
  fakes::posterior.force_sd = 0.17;
  EXPECT_EQ(b.tick(), tiller_status_contact);
}

TEST(Contact, LatchesSafeWhereThatIsAskedFor) {
  tiller::Config c = watched_pendulum();
  c.safety.contact_action = tiller_contact_safe;
  Bench b(c);
  fakes::posterior.force[0] = 0.9;
  (void)b.tick();
  EXPECT_NE(b.state(), tiller_state_safe) << "a robot that does not move may be touched";
  fakes::posterior.force[0] = 0.0;
  b.activate();
  EXPECT_EQ(b.state(), tiller_state_active);
  fakes::posterior.force[0] = 0.9;
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_safe);
  EXPECT_EQ(b.executive->info().first_fault, tiller_status_contact);
  fakes::posterior.force[0] = 0.0;
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_safe);
}

TEST(Contact, WithoutALimitThereIsNone) {
  tiller::Config c = watched_pendulum(HUGE_VAL);
  Bench b(c);
  b.activate();
  fakes::posterior.force[0] = 1e6;
  EXPECT_EQ(b.tick(), tiller_status_ok);
}

TEST(Contact, IsRefusedWhereNobodyFeelsIt) {
  tiller::Config c = watched_pendulum();
  const char* field = nullptr;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok);
  c.posterior.disturbance = 0;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_limit);
  EXPECT_STREQ(field, "safety.contact_force[1]");
  c = watched_pendulum();
  c.safety.contact_force[0] = 1.0;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_limit) << "no joint's velocity";
  EXPECT_STREQ(field, "safety.contact_force[0]");
}

}  // namespace
