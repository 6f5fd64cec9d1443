// The controller's side of the bus against emulated drives of each protocol, frame by frame in one process: what must
// hold for every drive stands here once.
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "drive_rig.hpp"

namespace tiller {
namespace {

constexpr double kRate_Nm_s = 10.0, kPeriod_s = 0.02;

struct Kind {
  std::string name;
  ActuatorSettings drive;
  double step_Nm;  ///< of a torque on the wire
};

/// Numbers that end at a range have 12 bits over it; other protocols send a float where not said otherwise.
Kind kind_of(const std::string& name, ActuatorSettings drive, double step_Nm = 1e-6) {
  const bool range = (actuator_protocol(drive.kind).capabilities & kEndsAtRange) != 0;
  return {name, drive, range ? 2 * drive.range.torque_Nm / 4095 : step_Nm};
}

/// Every protocol as it is by default, and the dialects of some.
std::vector<Kind> every_kind() {
  std::vector<Kind> kinds;
  for (const ActuatorKind kind : every_actuator()) {
    ActuatorSettings drive;
    drive.kind = kind;
    kinds.push_back(kind_of(actuator_name(kind).word, drive));
  }
  ActuatorSettings moteus;
  moteus.kind = ActuatorKind::moteus;
  moteus.resolution = MoteusResolution::int32;
  kinds.push_back(kind_of("moteus_int32", moteus, 0.001));
  moteus.resolution = MoteusResolution::int16;
  kinds.push_back(kind_of("moteus_int16", moteus, 0.01));
  ActuatorSettings mit;
  mit.kind = ActuatorKind::mit;
  for (const MitReply reply : {MitReply::ak, MitReply::damiao}) {
    mit.reply = reply;
    kinds.push_back(kind_of(std::string("mit_") + kMitReplyNames[static_cast<int>(reply)], mit));
  }
  return kinds;
}

class Drives : public ::testing::TestWithParam<Kind> {
 protected:
  static CanLayout layout() {
    CanLayout layout = one_motor(GetParam().drive.kind);
    layout.motors[0].entry_rate_per_s = kRate_Nm_s;
    layout.motors[0].drive = GetParam().drive;
    return layout;
  }
  static const char* reply() { return kMitReplyNames[static_cast<int>(GetParam().drive.reply)]; }
  static bool can(ActuatorCapability capability) {
    return (actuator_protocol(GetParam().drive.kind).capabilities_of(GetParam().drive) & capability) != 0;
  }

  void hear(const sim::CanFrames& frames) { bus.hear(frames, now_us); }
  void deliver(const CanFrame* frames, std::uint32_t count) { bus.deliver(frames, count, *drive, shaft, now_us); }

  /// A period: the drive speaks, the board stamps, the command goes out. Returns the torque that the drive makes.
  double period(tiller_state_t state, double torque_Nm, bool arrives = true) {
    hear(drive->before_reading());
    hear(sim::sensor_frames(kBoard, {now_us, ++sequence, {0.0}}));
    tiller_command_t command{};
    command.stamp_us = now_us;
    command.sequence = sequence;
    command.state = state;
    command.value[0] = torque_Nm;
    CanFrame frames[CanRobot::kMaxFrames];
    const std::uint32_t count = robot.command(command, frames);
    EXPECT_GT(count, 0u);
    const std::uint32_t gone = std::min(count, lost);
    if (arrives) deliver(frames + gone, count - gone);
    hear(drive->after_period(shaft));
    now_us += 20000;
    return drive->torque_Nm();
  }
  void run_to(double torque_Nm) {
    for (int k = 0; k < 200; ++k) period(tiller_state_active, torque_Nm);
    EXPECT_NEAR(torque_Nm, drive->torque_Nm(), GetParam().step_Nm);
  }

  RobotBus bus{layout()};
  CanRobot& robot = bus.robot;
  std::unique_ptr<sim::DriveAxis> drive = emulated(GetParam().drive.kind, reply());
  sim::Shaft shaft{0.3, -0.2};
  std::int64_t now_us = 1000000;
  std::uint32_t sequence = 0;
  std::uint32_t lost = 0;  ///< so many of a period's first frames do not arrive
};

// From whatever the plan says while the drive gets ready, the torque rises from none at the rate limit.
TEST_P(Drives, EntersWithoutAKick) {
  double before = 0.0;
  int reached = -1;
  for (int k = 0; k < 100; ++k) {
    const double torque = period(tiller_state_active, 8.0);
    EXPECT_LE(std::fabs(torque - before), kRate_Nm_s * kPeriod_s + GetParam().step_Nm * 1.001) << k;
    if (k == 0) {
      EXPECT_LE(std::fabs(torque), GetParam().step_Nm) << "the drive has confirmed nothing yet";
    }
    if (reached < 0 && torque >= 8.0 - GetParam().step_Nm) reached = k;
    before = torque;
  }
  EXPECT_GE(reached, 39) << "0.2 Nm a period";
  EXPECT_LE(reached, 43 + 4) << "and four requests more where the drive does not prove that it took the first";
  // once in, commands pass as they are: their rate is the output gate's matter
  EXPECT_NEAR(-5.0, period(tiller_state_active, -5.0), GetParam().step_Nm);
}

TEST_P(Drives, PreparedInStandbyItFollowsTheFirstCommand) {
  robot.prepare(true);
  EXPECT_FALSE(robot.is_ready());
  for (int k = 0; k < 5; ++k) EXPECT_LE(std::fabs(period(tiller_state_standby, 0.0)), GetParam().step_Nm);
  EXPECT_TRUE(robot.is_ready());
  EXPECT_EQ(tiller_status_ok, robot.fault()) << robot.fault_text();
  EXPECT_NEAR(0.19, period(tiller_state_active, 0.19), GetParam().step_Nm);
}

// Whatever the safe command is and whoever prepares, before motion is permitted.
TEST_P(Drives, KeptOffItStaysOffUntilMotionIsPermitted) {
  robot.keep_off(true);
  robot.prepare(true);
  for (const tiller_state_t state : {tiller_state_init, tiller_state_standby, tiller_state_safe})
    for (int k = 0; k < 8; ++k) {
      EXPECT_EQ(0.0, period(state, 2.0));
      EXPECT_FALSE(robot.motor(0).enabled) << state;
    }
  robot.keep_off(false);
  for (int k = 0; k < 8; ++k) period(tiller_state_standby, 0.0);
  EXPECT_TRUE(robot.is_ready());
}

// An ODrive reports closed loop although the frame that chose the torque mode was lost; a plain drive of the MIT
// protocol answers whether it has entered its motor mode or not. Whichever of the first requests are lost, the drive
// obeys.
TEST_P(Drives, NoLostRequestLeavesItDeaf) {
  for (unsigned pattern = 0; pattern < 1u << (ActuatorAxis::kBlindRequests - 1); ++pattern) {
    bus = RobotBus(layout());
    drive = emulated(GetParam().drive.kind, reply());
    double before = 0.0;
    int periods = 1;  // since the drive has heard the last command
    for (unsigned k = 0; k < 60; ++k) {
      lost = k < 32 ? pattern >> k & 1u : 0u;
      const double torque = period(tiller_state_active, 8.0);
      EXPECT_LE(std::fabs(torque - before), periods * kRate_Nm_s * kPeriod_s + GetParam().step_Nm * 1.001) << "a kick";
      periods = lost != 0 ? periods + 1 : 1;
      before = torque;
    }
    ASSERT_NEAR(8.0, before, GetParam().step_Nm) << "lost: " << pattern;
    ASSERT_EQ(tiller_status_ok, robot.fault());
  }
}

TEST_P(Drives, StandbyAndSafeSetItFree) {
  for (int k = 0; k < 3; ++k) period(tiller_state_standby, 0.0);
  EXPECT_EQ(0.0, drive->torque_Nm());
  run_to(2.0);
  EXPECT_TRUE(robot.is_ready());
  period(tiller_state_safe, 0.0);
  EXPECT_EQ(0.0, drive->torque_Nm());
  for (int k = 0; k < 20; ++k) period(tiller_state_safe, 0.0);
  EXPECT_EQ(tiller_status_ok, robot.fault());
  EXPECT_FALSE(robot.is_ready());
}

TEST_P(Drives, AnExpiredWatchdogIsAFaultInTheNextReportAndIsNotUndoneByCommands) {
  run_to(2.0);
  drive->expire_watchdog();
  EXPECT_EQ(0.0, drive->torque_Nm());
  if (!can(kTellsFaults)) return;  // a plain one goes on with the next command: its manual says so, and so does docs
  period(tiller_state_active, 2.0);
  period(tiller_state_active, 2.0, false);
  ASSERT_EQ(tiller_status_actuator_fault, robot.fault());
  EXPECT_NE(nullptr, robot.fault_text());
  for (int k = 0; k < 50; ++k) {
    EXPECT_EQ(0.0, period(tiller_state_active, 2.0)) << k;
    EXPECT_EQ(tiller_status_actuator_fault, robot.fault()) << k;
  }
  // nor by SAFE, which stops what runs and leaves the evidence
  for (int k = 0; k < 5; ++k) EXPECT_EQ(0.0, period(tiller_state_safe, 0.0));
  if (GetParam().drive.reply != MitReply::ak) {
    EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  }
  CanFrame frames[CanRobot::kMaxFrames];
  const std::uint32_t count = robot.clear_faults(frames);
  deliver(frames, count);
  hear(drive->before_reading());
  EXPECT_EQ(tiller_status_ok, robot.fault());
  run_to(2.0);
  EXPECT_EQ(tiller_status_ok, robot.fault());
}

TEST_P(Drives, OneThatDropsOutOnItsOwnIsNotPulledBackIn) {
  if (!can(kTellsEnabled)) return;
  run_to(2.0);
  // somebody else switches it off
  CanFrame frames[ActuatorProtocol::kMaxFrames];
  const std::uint32_t count = actuator_protocol(GetParam().drive.kind).disable(robot.layout().motors[0].drive, frames);
  deliver(frames, count);
  hear(drive->before_reading());
  ASSERT_EQ(tiller_status_actuator_fault, robot.fault());
  for (int k = 0; k < 20; ++k) EXPECT_EQ(0.0, period(tiller_state_active, 2.0)) << k;
}

TEST_P(Drives, ReportsWhereItIsAndHowItDoes) {
  run_to(2.0);
  const ActuatorState& state = robot.motor(0);
  EXPECT_TRUE(state.heard && state.enabled);
  EXPECT_GE(state.heard_us, now_us - 40000);
  const bool coarse = can(kEndsAtRange);
  EXPECT_NEAR(0.3, state.position_rad, coarse ? 25.0 / 65535 : 7e-4);
  EXPECT_NEAR(-0.2, state.velocity_rad_s, coarse ? 100.0 / 4095 : 2e-3);
  if (!can(kSpeaksUnasked)) {  // which sends torques where it is configured to
    EXPECT_NEAR(2.0, state.torque_Nm, 2 * GetParam().step_Nm);
  }
  EXPECT_EQ(0u, state.fault);
}

TEST_P(Drives, OneThatBreaksDownIsAFaultWhereItCanSaySo) {
  run_to(2.0);
  drive->break_down();
  EXPECT_EQ(0.0, drive->torque_Nm());
  for (int k = 0; k < 2; ++k) period(tiller_state_active, 2.0);
  if (!can(kTellsFaults)) return;
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  EXPECT_NE(nullptr, robot.fault_text());
}

TEST_P(Drives, ASilentOneIsAFault) {
  run_to(2.0);
  for (int k = 0; k < 26; ++k) {  // the stamps go on, the drive does not
    EXPECT_EQ(tiller_status_ok, robot.fault()) << k;
    hear(sim::sensor_frames(kBoard, {now_us, ++sequence, {0.0}}));
    now_us += 20000;
  }
  hear(sim::sensor_frames(kBoard, {now_us, ++sequence, {0.0}}));
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
}

TEST_P(Drives, NothingGoesOutForWhatIsNotFinite) {
  tiller_command_t command{};
  command.state = tiller_state_active;
  CanFrame frames[CanRobot::kMaxFrames];
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e300}) {
    command.value[0] = bad;
    EXPECT_EQ(0u, robot.command(command, frames)) << bad;
  }
}

INSTANTIATE_TEST_SUITE_P(All, Drives, ::testing::ValuesIn(every_kind()),
                         [](const ::testing::TestParamInfo<Kind>& one) { return one.param.name; });

}  // namespace
}  // namespace tiller
