#include "safety/state_machine.hpp"

#include <gtest/gtest.h>

namespace tiller {
namespace {

constexpr tiller_state_t kInit = tiller_state_init, kStandby = tiller_state_standby, kActive = tiller_state_active,
                         kHold = tiller_state_hold, kSafe = tiller_state_safe;

/// A machine brought to `state` by the events that lead there.
StateMachine machine_in(tiller_state_t state) {
  StateMachine m;
  if (state == kSafe) {
    (void)m.on(Event::stop, tiller_status_stopped);
    return m;
  }
  if (state == kInit) return m;
  (void)m.on(Event::measured);
  if (state == kStandby) return m;
  (void)m.on(Event::arm);
  m.on_measurement();
  if (state == kActive) return m;
  (void)m.on(Event::plan_failed, tiller_status_plan_not_finite);
  return m;
}

struct Entry {
  tiller_state_t from;
  Event event;
  tiller_state_t to;
  bool allowed;
};

// The specification, written a second time and by transition instead of by row: every state with every event.
const Entry kSpecification[] = {
    {kInit, Event::arm, kInit, true},
    {kInit, Event::disarm, kInit, true},
    {kInit, Event::stop, kSafe, true},
    {kInit, Event::reset, kInit, true},
    {kInit, Event::measured, kStandby, true},
    {kInit, Event::cleared, kActive, true},
    {kInit, Event::plan_good, kInit, true},
    {kInit, Event::plan_failed, kInit, true},
    {kInit, Event::hold_expired, kInit, true},
    {kInit, Event::sensor_fault, kInit, true},
    {kInit, Event::clock_set, kInit, true},
    {kStandby, Event::arm, kStandby, true},
    {kStandby, Event::disarm, kStandby, true},
    {kStandby, Event::stop, kSafe, true},
    {kStandby, Event::reset, kInit, true},
    {kStandby, Event::measured, kStandby, true},
    {kStandby, Event::cleared, kActive, true},
    {kStandby, Event::plan_good, kStandby, true},
    {kStandby, Event::plan_failed, kStandby, true},
    {kStandby, Event::hold_expired, kStandby, true},
    {kStandby, Event::sensor_fault, kSafe, true},
    {kStandby, Event::clock_set, kInit, true},
    {kActive, Event::arm, kActive, true},
    {kActive, Event::disarm, kStandby, true},
    {kActive, Event::stop, kSafe, true},
    {kActive, Event::reset, kActive, false},
    {kActive, Event::measured, kActive, true},
    {kActive, Event::cleared, kActive, true},
    {kActive, Event::plan_good, kActive, true},
    {kActive, Event::plan_failed, kHold, true},
    {kActive, Event::hold_expired, kActive, true},
    {kActive, Event::sensor_fault, kSafe, true},
    {kActive, Event::clock_set, kActive, true},
    {kHold, Event::arm, kHold, true},
    {kHold, Event::disarm, kStandby, true},
    {kHold, Event::stop, kSafe, true},
    {kHold, Event::reset, kHold, false},
    {kHold, Event::measured, kHold, true},
    {kHold, Event::cleared, kHold, true},
    {kHold, Event::plan_good, kActive, true},
    {kHold, Event::plan_failed, kHold, true},
    {kHold, Event::hold_expired, kSafe, true},
    {kHold, Event::sensor_fault, kSafe, true},
    {kHold, Event::clock_set, kHold, true},
    {kSafe, Event::arm, kSafe, false},
    {kSafe, Event::disarm, kSafe, false},
    {kSafe, Event::stop, kSafe, true},
    {kSafe, Event::reset, kInit, true},
    {kSafe, Event::measured, kSafe, true},
    {kSafe, Event::cleared, kSafe, true},
    {kSafe, Event::plan_good, kSafe, true},
    {kSafe, Event::plan_failed, kSafe, true},
    {kSafe, Event::hold_expired, kSafe, true},
    {kSafe, Event::sensor_fault, kSafe, true},
    {kSafe, Event::clock_set, kSafe, true},
};

// Requirement: SR-3, SR-4, SR-5, SR-6, SR-7, SR-10, SR-12
TEST(StateMachine, EveryStateWithEveryEvent) {
  ASSERT_EQ(sizeof kSpecification / sizeof *kSpecification, static_cast<std::size_t>(kStateCount * kEventCount));
  bool seen[kStateCount][kEventCount] = {};
  for (const Entry& e : kSpecification) {
    StateMachine m = machine_in(e.from);
    ASSERT_EQ(m.state(), e.from);
    const bool was_armed = m.armed();
    const tiller_status_t status = m.on(e.event, tiller_status_sensor_stale);
    const int column = static_cast<int>(e.event);
    EXPECT_EQ(m.state(), e.to) << "state " << e.from << " event " << column;
    EXPECT_EQ(status, e.allowed ? tiller_status_ok : tiller_status_wrong_state)
        << "state " << e.from << " event " << column;
    if (!e.allowed) {
      EXPECT_EQ(m.armed(), was_armed);
    }
    EXPECT_FALSE(seen[e.from][column]) << "listed twice";
    seen[e.from][column] = true;
  }
}

// Requirement: SR-5
TEST(StateMachine, MotionNeedsBothArmingAndAMeasurement) {
  StateMachine m;
  m.on_measurement();
  EXPECT_EQ(m.state(), kStandby);
  m.on_measurement();
  EXPECT_EQ(m.state(), kStandby);
  EXPECT_EQ(m.on(Event::arm), tiller_status_ok);
  EXPECT_EQ(m.state(), kStandby) << "planning begins with the next valid measurement";
  m.on_measurement();
  EXPECT_EQ(m.state(), kActive);

  StateMachine early;
  EXPECT_EQ(early.on(Event::arm), tiller_status_ok);
  EXPECT_EQ(early.state(), kInit);
  early.on_measurement();
  EXPECT_EQ(early.state(), kActive);
}

TEST(StateMachine, DisarmedBeforeTheFirstMeasurementStaysDisarmed) {
  StateMachine m;
  (void)m.on(Event::arm);
  (void)m.on(Event::disarm);
  m.on_measurement();
  EXPECT_EQ(m.state(), kStandby);
}

TEST(StateMachine, ResetDisarmsAlsoWhereNothingWasWrong) {
  for (const bool measured : {false, true}) {
    StateMachine m;
    if (measured) m.on_measurement();
    ASSERT_EQ(m.on(Event::arm), tiller_status_ok);
    ASSERT_EQ(m.on(Event::reset), tiller_status_ok);
    EXPECT_FALSE(m.armed());
    m.on_measurement();
    EXPECT_EQ(m.state(), tiller_state_standby);
  }
}

TEST(StateMachine, SafeKeepsTheFirstFaultUntilReset) {
  StateMachine m = machine_in(kActive);
  (void)m.on(Event::sensor_fault, tiller_status_sensor_frozen);
  (void)m.on(Event::sensor_fault, tiller_status_sensor_stale);
  (void)m.on(Event::stop, tiller_status_stopped);
  EXPECT_EQ(m.state(), kSafe);
  EXPECT_EQ(m.first_fault(), tiller_status_sensor_frozen);
  EXPECT_FALSE(m.armed());
  EXPECT_EQ(m.on(Event::reset), tiller_status_ok);
  EXPECT_EQ(m.first_fault(), tiller_status_ok);
  m.on_measurement();
  EXPECT_EQ(m.state(), kStandby) << "a reset disarms";
}

TEST(StateMachine, HoldKeepsItsReasonIntoSafeAndForgetsItOnRecovery) {
  StateMachine m = machine_in(kHold);
  EXPECT_EQ(m.first_fault(), tiller_status_plan_not_finite);
  StateMachine recovered = m;
  (void)recovered.on(Event::plan_good);
  EXPECT_EQ(recovered.state(), kActive);
  EXPECT_EQ(recovered.first_fault(), tiller_status_ok);
  (void)m.on(Event::hold_expired, tiller_status_deadline_missed);
  EXPECT_EQ(m.state(), kSafe);
  EXPECT_EQ(m.first_fault(), tiller_status_plan_not_finite);
}

}  // namespace
}  // namespace tiller
