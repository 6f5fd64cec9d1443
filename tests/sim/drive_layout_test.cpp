// Settings that only some drives have, and which drives may share a bus.
#include "drive_rig.hpp"
#include "sim/devices/moteus_axis.hpp"

namespace tiller {
namespace {

TEST(DrivePositions, APositionCommandBeginsWhereTheShaftIs) {
  for (const ActuatorKind kind : every_actuator()) {
    CanLayout layout = one_motor(kind);
    layout.motors[0].drive.mode = ActuatorMode::position;
    layout.motors[0].drive.kp_Nm_rad = 5.0;
    EXPECT_NE(nullptr, can_layout_error(layout)) << "without a rate it would jump";
    layout.motors[0].entry_rate_per_s = 1.0;
    ASSERT_EQ(nullptr, can_layout_error(layout));
    ActuatorAxis axis;
    ActuatorSettings settings = layout.motors[0].drive;
    settings.node = kMotor;
    axis.reset(settings, 1.0);
    CanFrame frames[ActuatorAxis::kMaxFrames];
    axis.command(true, 2.0, 0, frames);
    EXPECT_EQ(0.0, axis.set_point()) << "and while it is not known where, the drive stays off";
    EXPECT_FALSE(axis.is_confirmed());

    const auto drive = emulated(kind);
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
  CanLayout layout = one_motor(ActuatorKind::moteus);
  layout.channel_count = 2;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  layout.channels[1] = {CanSource::kSensor, 0};
  RobotBus bus(layout);
  CanRobot& robot = bus.robot;
  sim::MoteusAxis drive(kMotor);
  CanFrame frames[CanRobot::kMaxFrames];
  const auto deliver = [&](std::uint32_t count, double position_rad) {
    bus.deliver(frames, count, drive, {position_rad, 0});
  };
  tiller_measurement_t measurement;
  tiller_command_t command{};
  command.state = tiller_state_active;
  deliver(robot.command(command, frames), 1.0);  // the answer to a command, a period before the board reads
  bus.hear(sim::sensor_frames(kBoard, {1000, 1, {0.5}}));
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

/// Without a board somebody has to ask before each tick, and what was told before the question is of another time.
TEST(Moteus, WithoutABoardTheMeasurementIsTheAnswerToTheQuestion) {
  CanLayout layout = one_motor(ActuatorKind::moteus);
  layout.sensor_node = CanLayout::kNoBoard;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  RobotBus bus(layout);
  CanRobot& robot = bus.robot;
  ASSERT_TRUE(robot.needs_asking());
  sim::MoteusAxis drive(kMotor);
  CanFrame frames[CanRobot::kMaxFrames];
  tiller_measurement_t measurement;
  tiller_command_t command{};
  command.state = tiller_state_active;
  std::int64_t now_us = 1000000;
  for (int k = 0; k < 20; ++k, now_us += 20000) {
    const double position_rad = 0.01 * k;
    const std::uint32_t asked = robot.ask(frames);
    ASSERT_EQ(1u, asked);
    EXPECT_FALSE(robot.take(&measurement)) << "the answer to the command is of the period before";
    bus.deliver(frames, asked, drive, {position_rad, 0}, now_us);
    ASSERT_TRUE(robot.take(&measurement));
    EXPECT_NEAR(position_rad, measurement.value[0], 1e-6);
    EXPECT_EQ(now_us, measurement.stamp_us);
    EXPECT_FALSE(robot.take(&measurement)) << "once";
    bus.deliver(frames, robot.command(command, frames), drive, {position_rad + 0.005, 0}, now_us + 3000);
  }
}

/// Drives that answer nothing but commands are measured by those answers, asked or not.
TEST(Mit, WithoutABoardTheMeasurementIsTheAnswerToTheCommand) {
  CanLayout layout = one_motor(ActuatorKind::mit);
  layout.sensor_node = CanLayout::kNoBoard;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  RobotBus bus(layout);
  CanRobot& robot = bus.robot;
  ASSERT_TRUE(robot.needs_asking());
  const auto drive = emulated(ActuatorKind::mit);
  CanFrame frames[CanRobot::kMaxFrames];
  tiller_measurement_t measurement;
  tiller_command_t command{};
  command.state = tiller_state_active;
  std::int64_t now_us = 1000000;
  for (int k = 0; k < 20; ++k, now_us += 20000) {
    bus.deliver(frames, robot.ask(frames), *drive, {0.01 * k, 0}, now_us);
    if (k > 0) {
      ASSERT_TRUE(robot.take(&measurement)) << k;
      EXPECT_NEAR(0.01 * k - 0.005, measurement.value[0], 0.006);
    } else {
      (void)robot.take(&measurement);
    }
    bus.deliver(frames, robot.command(command, frames), *drive, {0.01 * k + 0.005, 0}, now_us + 3000);
  }
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
