// The controller's side of the bus against emulated drives of each protocol, frame by frame in one process: what must
// hold for every drive stands here once.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "io/can_robot.hpp"
#include "sim/drive_axis.hpp"
#include "sim/mit_axis.hpp"
#include "sim/moteus_axis.hpp"
#include "sim/odrive_axis.hpp"
#include "sim/sensor_board.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kBoard = 48;
constexpr double kRate_Nm_s = 10.0, kPeriod_s = 0.02;

struct Kind {
  const char* name;
  ActuatorKind kind;
  MitReply reply;
  MoteusResolution resolution;
  double step_Nm;  ///< of a torque on the wire
};

const Kind kKinds[] = {
    {"odrive", ActuatorKind::odrive, MitReply::plain, MoteusResolution::f32, 1e-6},
    {"moteus_f32", ActuatorKind::moteus, MitReply::plain, MoteusResolution::f32, 1e-6},
    {"moteus_int32", ActuatorKind::moteus, MitReply::plain, MoteusResolution::int32, 0.001},
    {"moteus_int16", ActuatorKind::moteus, MitReply::plain, MoteusResolution::int16, 0.01},
    {"mit_plain", ActuatorKind::mit, MitReply::plain, MoteusResolution::f32, 36.0 / 4095},
    {"mit_ak", ActuatorKind::mit, MitReply::ak, MoteusResolution::f32, 36.0 / 4095},
    {"mit_damiao", ActuatorKind::mit, MitReply::damiao, MoteusResolution::f32, 36.0 / 4095},
};

CanFrame to_robot(const sim::CanFrame& frame) {
  CanFrame out;
  out.id = frame.id;
  out.length = frame.length;
  out.extended = frame.extended;
  out.fd = frame.fd;
  std::copy(frame.data.begin(), frame.data.end(), out.data);
  return out;
}

sim::CanFrame to_drive(const CanFrame& frame) {
  sim::CanFrame out;
  out.id = frame.id;
  out.length = frame.length;
  out.extended = frame.extended;
  out.fd = frame.fd;
  std::copy(frame.data, frame.data + 64, out.data.begin());
  return out;
}

class Drives : public ::testing::TestWithParam<Kind> {
 protected:
  void SetUp() override {
    CanLayout layout;
    layout.motor_count = layout.channel_count = 1;
    CanMotor& motor = layout.motors[0];
    motor.node = 3;
    motor.wheel_radius_m = 1.0;
    motor.entry_rate_per_s = kRate_Nm_s;
    motor.drive.kind = GetParam().kind;
    motor.drive.reply = GetParam().reply;
    motor.drive.resolution = GetParam().resolution;
    layout.sensor_node = kBoard;
    ASSERT_EQ(nullptr, can_layout_error(layout));
    robot.reset(layout);
    sim::DriveOptions options;
    options.protocol = actuator_protocol(GetParam().kind).name;
    options.node = 3;
    options.reply = GetParam().reply == MitReply::damiao ? "damiao" : GetParam().reply == MitReply::ak ? "ak" : "plain";
    std::string error;
    drive = sim::make_drive(options, error);
    ASSERT_NE(nullptr, drive) << error;
  }

  void hear(const sim::CanFrames& frames) {
    for (const sim::CanFrame& frame : frames)
      EXPECT_TRUE(robot.receive(to_robot(frame), now_us)) << "identifier " << frame.id;
  }

  /// A period: the drive speaks, the board stamps, the command goes out. Returns the torque that the drive makes.
  double period(tiller_state_t state, double torque_Nm, bool deliver = true) {
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
    sent = count;
    for (std::uint32_t i = 0; deliver && i < count; ++i) {
      sim::CanFrames replies;
      drive->take(to_drive(frames[i]), shaft, replies);
      hear(replies);
    }
    hear(drive->after_period(shaft));
    now_us += 20000;
    return drive->torque_Nm();
  }
  bool tells_enabled() const { return GetParam().reply == MitReply::damiao || GetParam().kind != ActuatorKind::mit; }
  bool tells_faults() const { return GetParam().reply != MitReply::plain || GetParam().kind != ActuatorKind::mit; }
  void run_to(double torque_Nm) {
    for (int k = 0; k < 200; ++k) period(tiller_state_active, torque_Nm);
    EXPECT_NEAR(torque_Nm, drive->torque_Nm(), GetParam().step_Nm);
  }

  CanRobot robot;
  std::unique_ptr<sim::DriveAxis> drive;
  sim::Shaft shaft{0.3, -0.2};
  std::int64_t now_us = 1000000;
  std::uint32_t sequence = 0, sent = 0;
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
  EXPECT_LE(reached, 43);
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
  if (!tells_faults()) return;  // a plain one goes on with the next command: its manual says so, and so does docs
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
  if (GetParam().reply != MitReply::ak) {
    EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  }
  CanFrame frames[CanRobot::kMaxFrames];
  const std::uint32_t count = robot.clear_faults(frames);
  for (std::uint32_t i = 0; i < count; ++i) {
    sim::CanFrames replies;
    drive->take(to_drive(frames[i]), shaft, replies);
    hear(replies);
  }
  hear(drive->before_reading());
  EXPECT_EQ(tiller_status_ok, robot.fault());
  run_to(2.0);
  EXPECT_EQ(tiller_status_ok, robot.fault());
}

TEST_P(Drives, OneThatDropsOutOnItsOwnIsNotPulledBackIn) {
  if (!tells_enabled()) return;
  run_to(2.0);
  // somebody else switches it off
  CanFrame frames[ActuatorProtocol::kMaxFrames];
  const std::uint32_t count = actuator_protocol(GetParam().kind).disable(robot.layout().motors[0].drive, frames);
  for (std::uint32_t i = 0; i < count; ++i) {
    sim::CanFrames replies;
    drive->take(to_drive(frames[i]), shaft, replies);
    hear(replies);
  }
  hear(drive->before_reading());
  ASSERT_EQ(tiller_status_actuator_fault, robot.fault());
  for (int k = 0; k < 20; ++k) EXPECT_EQ(0.0, period(tiller_state_active, 2.0)) << k;
}

TEST_P(Drives, ReportsWhereItIsAndHowItDoes) {
  run_to(2.0);
  const ActuatorState& state = robot.motor(0);
  EXPECT_TRUE(state.heard && state.enabled);
  EXPECT_GE(state.heard_us, now_us - 40000);
  const bool coarse = GetParam().kind == ActuatorKind::mit;
  EXPECT_NEAR(0.3, state.position_rad, coarse ? 25.0 / 65535 : 7e-4);
  EXPECT_NEAR(-0.2, state.velocity_rad_s, coarse ? 100.0 / 4095 : 2e-3);
  if (GetParam().kind != ActuatorKind::odrive) {  // which sends torques where it is configured to
    EXPECT_NEAR(2.0, state.torque_Nm, 2 * GetParam().step_Nm);
  }
  EXPECT_EQ(0u, state.fault);
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

// Damage behind the controller chip, which CAN's own checks do not see.
TEST(ProtectedBoard, EveryFlipOfOneOrTwoBitsIsRefused) {
  std::uint64_t tried = 0;
  std::uint32_t random = 12345;
  const auto next = [&] { return random = random * 1664525u + 1013904223u; };
  for (int round = 0; round < 250; ++round) {
    const double reading = 1e-3 * static_cast<double>(next() % 2000000u) - 1000.0;
    const sim::CanFrames frames = sim::sensor_frames(kBoard, {next(), next(), {reading}}, true);
    for (const sim::CanFrame& sent : frames) {
      BoardReader reader;
      const CanFrame good = to_robot(sent);
      ASSERT_NE(BoardFrame::Kind::refused, reader.read(good).kind);
      for (int a = 0; a < 64; ++a) {
        for (int b = a; b < 64; ++b) {
          CanFrame bad = good;
          bad.data[a / 8] ^= static_cast<std::uint8_t>(1 << a % 8);
          if (b != a) bad.data[b / 8] ^= static_cast<std::uint8_t>(1 << b % 8);
          ASSERT_EQ(BoardFrame::Kind::refused, reader.read(bad).kind) << a << " " << b;
          ++tried;
        }
      }
      CanFrame elsewhere = good;
      elsewhere.id ^= 1u;  // delivered under the next channel's name
      ASSERT_EQ(BoardFrame::Kind::refused, reader.read(elsewhere).kind);
    }
  }
  EXPECT_GE(tried, 1000000u);
}

TEST(ProtectedBoard, BothLayoutsTellTheSameAndThereIsNoWayBack) {
  CanLayout layout;
  layout.motor_count = layout.channel_count = 1;
  layout.motors[0].node = 3;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.heartbeat_timeout_us = 0;
  CanRobot robot;
  robot.reset(layout);
  tiller_measurement_t measurement;
  const auto hear = [&](std::uint32_t sequence, bool is_protected) {
    for (const sim::CanFrame& frame :
         sim::sensor_frames(kBoard, {20000 * std::int64_t{sequence % 1000}, sequence, {0.25}}, is_protected))
      robot.receive(to_robot(frame), 20000 * std::int64_t{sequence % 1000});
    return robot.take(&measurement) && measurement.sequence == sequence && measurement.value[0] == 0.25;
  };
  const auto status_version = [&] {
    tiller_command_t command{};
    CanFrame frames[CanRobot::kMaxFrames];
    const CanFrame& status = frames[robot.command(command, frames) - 1];
    sim::PlantCommand answer;
    EXPECT_TRUE(sim::read_controller_status(kBoard, to_drive(status), answer));
    CanFrame damaged = status;
    damaged.data[0] ^= 1u;
    EXPECT_EQ(status.data[5] >> 4 == 0, sim::read_controller_status(kBoard, to_drive(damaged), answer));
    return status.data[5] >> 4;
  };
  EXPECT_TRUE(hear(1, false));
  EXPECT_EQ(0, status_version());
  EXPECT_TRUE(hear(2, true));
  EXPECT_EQ(1, status_version());
  EXPECT_FALSE(hear(3, false)) << "a board that protected its frames goes on doing so";
  EXPECT_TRUE(hear(4, true));
  EXPECT_FALSE(hear(4, true)) << "once";
  EXPECT_FALSE(hear(3, true)) << "nor older ones";
}

// 24 bits of the number travel; beyond them it is carried on.
TEST(ProtectedBoard, TheNumberGoesOnOverItsTwentyFourBits) {
  CanLayout layout;
  layout.motor_count = layout.channel_count = 1;
  layout.motors[0].node = 3;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.heartbeat_timeout_us = 0;
  CanRobot robot;
  robot.reset(layout);
  tiller_measurement_t measurement;
  for (std::uint32_t sequence = 0xfffffd; sequence < 0x1000003; ++sequence) {
    for (const sim::CanFrame& frame : sim::sensor_frames(kBoard, {1000, sequence, {0.25}}, true))
      robot.receive(to_robot(frame), 1000);
    ASSERT_TRUE(robot.take(&measurement));
    EXPECT_EQ(sequence, measurement.sequence);
  }
}

INSTANTIATE_TEST_SUITE_P(All, Drives, ::testing::ValuesIn(kKinds),
                         [](const ::testing::TestParamInfo<Kind>& one) { return std::string(one.param.name); });

// ---- what only some have ----

TEST(DrivePositions, APositionCommandBeginsWhereTheShaftIs) {
  for (const ActuatorKind kind : {ActuatorKind::odrive, ActuatorKind::moteus, ActuatorKind::mit}) {
    CanLayout layout;
    layout.motor_count = layout.channel_count = 1;
    layout.motors[0].node = 3;
    layout.motors[0].wheel_radius_m = 1.0;
    layout.motors[0].drive.kind = kind;
    layout.motors[0].drive.mode = ActuatorMode::position;
    layout.motors[0].drive.kp_Nm_rad = 5.0;
    EXPECT_NE(nullptr, can_layout_error(layout)) << "without a rate it would jump";
    layout.motors[0].entry_rate_per_s = 1.0;
    ASSERT_EQ(nullptr, can_layout_error(layout));
    ActuatorAxis axis;
    ActuatorSettings settings = layout.motors[0].drive;
    settings.node = 3;
    axis.reset(settings, 1.0);
    CanFrame frames[ActuatorAxis::kMaxFrames];
    axis.command(true, 2.0, 0, frames);
    EXPECT_EQ(0.0, axis.set_point()) << "and while it is not known where, the drive stays off";
    EXPECT_FALSE(axis.is_confirmed());

    sim::DriveOptions options;
    options.protocol = actuator_protocol(kind).name;
    options.node = 3;
    std::string error;
    const auto drive = sim::make_drive(options, error);
    const sim::Shaft shaft{-1.5, 0.0};
    double last = -1.5;
    for (int k = 1; k <= 500; ++k) {
      const std::uint32_t count = axis.command(true, 2.0, 20000 * k, frames);
      sim::CanFrames replies = drive->before_reading();
      for (std::uint32_t i = 0; i < count; ++i) drive->take(to_drive(frames[i]), shaft, replies);
      for (const sim::CanFrame& frame : drive->after_period(shaft)) replies.push_back(frame);
      for (const sim::CanFrame& frame : replies) axis.receive(to_robot(frame), 0);
      if (!axis.is_confirmed()) continue;
      EXPECT_LE(std::fabs(axis.set_point() - last), 0.02 + 25.0 / 65535) << k;
      last = axis.set_point();
    }
    EXPECT_EQ(2.0, last);
  }
}

TEST(Moteus, IsAskedWhenTheBoardStampsAndReadAtThatTime) {
  CanLayout layout;
  layout.motor_count = 1;
  layout.channel_count = 2;
  layout.motors[0].node = 3;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.motors[0].drive.kind = ActuatorKind::moteus;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  layout.channels[1] = {CanSource::kSensor, 0};
  ASSERT_EQ(nullptr, can_layout_error(layout));
  CanRobot robot;
  robot.reset(layout);
  sim::MoteusAxis drive(3);
  CanFrame frames[CanRobot::kMaxFrames];
  const auto deliver = [&](std::uint32_t count, double position_rad) {
    for (std::uint32_t i = 0; i < count; ++i) {
      sim::CanFrames replies;
      drive.take(to_drive(frames[i]), {position_rad, 0}, replies);
      for (const sim::CanFrame& frame : replies) EXPECT_TRUE(robot.receive(to_robot(frame), 0));
    }
  };
  tiller_measurement_t measurement;
  tiller_command_t command{};
  command.state = tiller_state_active;
  deliver(robot.command(command, frames), 1.0);  // the answer to a command, a period before the board reads
  for (const sim::CanFrame& frame : sim::sensor_frames(48, {1000, 1, {0.5}})) robot.receive(to_robot(frame), 0);
  EXPECT_FALSE(robot.take(&measurement)) << "that answer is of another time";
  const std::uint32_t count = robot.queries_due(frames);
  ASSERT_EQ(1u, count);
  EXPECT_EQ(0u, robot.queries_due(frames + 1)) << "once";
  const double torque_Nm = drive.torque_Nm();
  deliver(count, 2.0);
  EXPECT_EQ(torque_Nm, drive.torque_Nm()) << "a question commands nothing";
  ASSERT_TRUE(robot.take(&measurement));
  EXPECT_NEAR(2.0, measurement.value[0], 1e-6);
}

TEST(CanLayoutOfDrives, IdentifiersThatMeetAreRefused) {
  const auto two = [](ActuatorKind a, std::uint32_t node_a, ActuatorKind b, std::uint32_t node_b,
                      std::uint32_t board = CanLayout::kNoBoard) {
    CanLayout layout;
    layout.motor_count = 2;
    layout.channel_count = 1;
    layout.motors[0].node = node_a;
    layout.motors[0].drive.kind = a;
    layout.motors[1].node = node_b;
    layout.motors[1].drive.kind = b;
    layout.motors[0].wheel_radius_m = layout.motors[1].wheel_radius_m = 1.0;
    layout.sensor_node = board;
    layout.channels[0] = {CanSource::kMotorPosition, 0};
    return can_layout_error(layout);
  };
  EXPECT_EQ(nullptr, two(ActuatorKind::mit, 1, ActuatorKind::mit, 2)) << "one identifier for all is their way";
  EXPECT_NE(nullptr, two(ActuatorKind::mit, 1, ActuatorKind::mit, 1));
  EXPECT_NE(nullptr, two(ActuatorKind::moteus, 2, ActuatorKind::moteus, 2));
  EXPECT_EQ(nullptr, two(ActuatorKind::moteus, 2, ActuatorKind::moteus, 3));
  // moteus 1 answers under 0x100, which could be command 0 of ODrive 8, but that one is not read
  EXPECT_EQ(nullptr, two(ActuatorKind::moteus, 1, ActuatorKind::odrive, 8));
  // moteus 6 answers under 0x600, the stamp of board 48
  EXPECT_NE(nullptr, two(ActuatorKind::moteus, 6, ActuatorKind::moteus, 2, 48));
  EXPECT_EQ(nullptr, two(ActuatorKind::moteus, 6, ActuatorKind::moteus, 2, 40));
  EXPECT_NE(nullptr, two(ActuatorKind::mit, 1, ActuatorKind::moteus, 2, 40)) << "position of mit beside a board";
}

}  // namespace
}  // namespace tiller
