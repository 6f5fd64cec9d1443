#include "io/can_robot.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

// Frames are written byte by byte, after ODrive's protocol and the comments of sensors.dbc: the generated codec is
// under test too.

namespace tiller {
namespace {

constexpr std::uint32_t kMotor = 3, kBoard = 48;

CanLayout cart() {
  CanLayout layout;
  layout.motor_count = 1;
  layout.motors[0].node = kMotor;
  layout.motors[0].wheel_radius_m = 0.05;
  layout.channel_count = 2;
  layout.channels[0] = {CanSource::kSensor, 0};
  layout.channels[1] = {CanSource::kSensor, 1};
  return layout;
}

CanFrame frame_of(std::uint32_t node, std::uint32_t command, std::vector<std::uint8_t> bytes) {
  CanFrame frame;
  frame.id = node << 5 | command;
  frame.length = static_cast<std::uint8_t>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), frame.data);
  return frame;
}

std::vector<std::uint8_t> words(std::uint32_t low, std::uint32_t high) {
  std::vector<std::uint8_t> bytes;
  for (std::uint32_t word : {low, high})
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  return bytes;
}

std::uint32_t bits(float value) {
  std::uint32_t word;
  std::memcpy(&word, &value, sizeof word);
  return word;
}

float torque_of(const CanFrame& frame) {
  float value;
  std::memcpy(&value, frame.data, sizeof value);
  return value;
}

CanFrame heartbeat(std::uint32_t error, std::uint8_t state) { return frame_of(kMotor, 1, words(error, state)); }
CanFrame stamp(std::uint32_t sequence, std::uint32_t time_us) { return frame_of(kBoard, 0, words(time_us, sequence)); }
CanFrame value(std::uint32_t channel, std::int32_t reading, std::uint32_t sequence, bool valid = true) {
  return frame_of(kBoard, 16 + channel,
                  words(static_cast<std::uint32_t>(reading), (sequence & 0xffffu) | (valid ? 1u << 16 : 0)));
}

tiller_command_t command_of(tiller_state_t state, double force_N) {
  tiller_command_t command{};
  command.state = state;
  command.value[0] = force_N;
  return command;
}

class Robot : public ::testing::Test {
 protected:
  void SetUp() override { reset(cart()); }
  void reset(const CanLayout& layout) {
    ASSERT_EQ(nullptr, can_layout_error(layout));
    robot.reset(layout);
  }
  bool receive(const CanFrame& frame) { return robot.receive(frame, now_us); }
  void measurement(std::uint32_t sequence, std::uint32_t time_us) {
    EXPECT_TRUE(receive(stamp(sequence, time_us)));
    EXPECT_TRUE(receive(value(0, 1500000, sequence)));
    EXPECT_TRUE(receive(value(1, -2500000, sequence)));
  }
  std::vector<CanFrame> command(tiller_state_t state, double force_N) {
    CanFrame frames[CanRobot::kMaxFrames];
    tiller_command_t wanted = command_of(state, force_N);
    wanted.stamp_us = command_us += 20000;
    const std::uint32_t count = robot.command(wanted, frames);
    return {frames, frames + count};
  }
  static std::vector<std::uint32_t> ids(const std::vector<CanFrame>& frames) {
    std::vector<std::uint32_t> list;
    for (const CanFrame& frame : frames) list.push_back(frame.id);
    return list;
  }

  CanRobot robot;
  tiller_measurement_t taken{};
  std::int64_t now_us = 1000, command_us = 0;
};

constexpr std::uint32_t kMode = kMotor << 5 | 0x0b, kState = kMotor << 5 | 7, kTorque = kMotor << 5 | 0x0e,
                        kStatus = kBoard << 5 | 1;
using Ids = std::vector<std::uint32_t>;

// ---- measurements ----

TEST_F(Robot, AMeasurementIsAllChannelsOfOneSequenceInAnyOrder) {
  receive(value(1, -2500000, 5));
  EXPECT_FALSE(robot.take(&taken));
  receive(stamp(5, 100));
  EXPECT_FALSE(robot.take(&taken));
  receive(value(0, 1500000, 5));
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(5u, taken.sequence);
  EXPECT_EQ(100, taken.stamp_us);
  EXPECT_DOUBLE_EQ(1.5, taken.value[0]);
  EXPECT_DOUBLE_EQ(-2.5, taken.value[1]);
  EXPECT_FALSE(robot.take(&taken)) << "once";
}

TEST_F(Robot, PartsOfTwoSequencesNeverMix) {
  receive(stamp(5, 100));
  receive(value(0, 1500000, 5));
  receive(value(1, -1, 6));  // of 5 this channel was lost
  EXPECT_FALSE(robot.take(&taken));
  receive(stamp(6, 200));
  EXPECT_FALSE(robot.take(&taken));
  receive(value(0, 7000000, 6));
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(6u, taken.sequence);
  EXPECT_DOUBLE_EQ(7.0, taken.value[0]);
  EXPECT_EQ(1u, robot.dropped_old());
}

TEST_F(Robot, TheNewestWinsAndOldSequencesAreRefused) {
  measurement(5, 100);
  measurement(6, 200);
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(6u, taken.sequence);
  measurement(5, 300);
  measurement(6, 400);
  EXPECT_FALSE(robot.take(&taken));
  EXPECT_EQ(3u, robot.dropped_old());
}

TEST_F(Robot, TheClockGoesOnOverItsThirtyTwoBits) {
  measurement(1, 0xfffffff0u);
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(0xfffffff0ll, taken.stamp_us);
  measurement(2, 0x10u);
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(0x100000010ll, taken.stamp_us);
  measurement(3, 0x8u);
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(0x100000008ll, taken.stamp_us) << "a clock that goes back is shown as it is; the controller refuses it";
}

TEST_F(Robot, AnInvalidReadingIsMissing) {
  receive(stamp(1, 0));
  receive(value(0, 123, 1, false));
  receive(value(1, 1, 1));
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_TRUE(std::isnan(taken.value[0]));
  EXPECT_DOUBLE_EQ(1e-6, taken.value[1]);
}

TEST_F(Robot, MotorsOwnEncodersMeasureThroughTheWheel) {
  CanLayout layout = cart();
  layout.motors[0].wheel_radius_m = -0.1;  // mounted mirrored
  layout.channel_count = 3;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  layout.channels[2] = {CanSource::kMotorVelocity, 0};
  reset(layout);
  receive(stamp(1, 0));
  receive(value(1, 1, 1));
  EXPECT_FALSE(robot.take(&taken)) << "no estimate yet";
  EXPECT_TRUE(receive(frame_of(kMotor, 9, words(bits(2.0f), bits(-0.5f)))));
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_NEAR(-2.0 * 2 * 3.14159265358979 * 0.1, taken.value[0], 1e-12);
  EXPECT_NEAR(0.5 * 2 * 3.14159265358979 * 0.1, taken.value[2], 1e-12);
  receive(stamp(2, 20000));
  receive(value(1, 1, 2));
  EXPECT_FALSE(robot.take(&taken)) << "an estimate serves one measurement";
}

TEST_F(Robot, MotorsAloneAreStampedOnArrival) {
  CanLayout layout;
  layout.motor_count = layout.channel_count = 1;
  layout.motors[0].node = kMotor;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.sensor_node = CanLayout::kNoBoard;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  reset(layout);
  now_us = 123456;
  receive(frame_of(kMotor, 9, words(bits(0.25f), 0)));
  ASSERT_TRUE(robot.take(&taken));
  EXPECT_EQ(123456, taken.stamp_us);
  EXPECT_NEAR(1.5707963267949, taken.value[0], 1e-12);
  EXPECT_EQ((Ids{kMode, kState, kTorque}), ids(command(tiller_state_active, 1.0))) << "and nobody wants a status";
}

TEST_F(Robot, StatusTellsWhichMeasurementAndWhichPlanItComesFrom) {
  tiller_command_t c = command_of(tiller_state_active, 1.0);
  c.sequence = 0x01020304u;
  c.plan_sequence = 0xabcdef07u;
  CanFrame frames[CanRobot::kMaxFrames];
  const std::uint32_t count = robot.command(c, frames);
  ASSERT_GT(count, 0u);
  const CanFrame& status = frames[count - 1];
  EXPECT_EQ(kStatus, status.id);
  EXPECT_EQ(0x04, status.data[0]);
  EXPECT_EQ(tiller_state_active, status.data[4] & 0xf);
  EXPECT_EQ(0x07, status.data[6]) << "the low byte of the plan's number";
}

TEST_F(Robot, NotANumberFromAnEncoderIsRefused) {
  const float infinity = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(receive(frame_of(kMotor, 9, words(0x7fc00000u, 0))));
  EXPECT_FALSE(receive(frame_of(kMotor, 9, words(0, bits(infinity)))));
}

TEST_F(Robot, ShortAndUnknownFramesAreRefused) {
  const std::uint32_t nodes[] = {kMotor, kBoard};
  const std::uint32_t commands[] = {0, 1, 3, 9, 16, 17};
  for (std::uint32_t node : nodes)
    for (std::uint32_t command : commands)
      for (std::uint8_t length = 0; length < 8; ++length)
        EXPECT_FALSE(receive(frame_of(node, command, std::vector<std::uint8_t>(length, 0x55))));
  EXPECT_FALSE(receive(frame_of(kBoard, 28, words(0, 0)))) << "channel 12";
  EXPECT_FALSE(receive(frame_of(kMotor + 1, 1, words(1, 0))));
  EXPECT_FALSE(robot.take(&taken));
  EXPECT_EQ(tiller_status_ok, robot.fault());
}

// ---- commands ----

TEST_F(Robot, ActiveMeansTorqueModeClosedLoopAndForceTimesRadius) {
  const std::vector<CanFrame> frames = command(tiller_state_active, 10.0);
  ASSERT_EQ((Ids{kMode, kState, kTorque, kStatus}), ids(frames));
  EXPECT_EQ(1, frames[0].data[0]);
  EXPECT_EQ(1, frames[0].data[4]);
  EXPECT_EQ(8, frames[1].data[0]);
  EXPECT_EQ(4, frames[2].length);
  EXPECT_EQ(0.0f, torque_of(frames[2])) << "nothing before the driver says that it is in closed loop";
  EXPECT_EQ(2, frames[3].data[4]) << "the state";
  receive(heartbeat(0, 8));
  for (std::uint32_t k = 1; k < ActuatorAxis::kBlindRequests; ++k) {
    const std::vector<CanFrame> again = command(tiller_state_active, 10.0);
    ASSERT_EQ((Ids{kMode, kState, kTorque, kStatus}), ids(again)) << "closed loop does not prove the mode";
    EXPECT_EQ(0.0f, torque_of(again[2])) << k;
  }
  const std::uint8_t half_Nm[] = {0x00, 0x00, 0x00, 0x3f};
  EXPECT_EQ(0, std::memcmp(half_Nm, command(tiller_state_active, 10.0)[0].data, 4));
  EXPECT_EQ((Ids{kTorque, kStatus}), ids(command(tiller_state_active, 1.0))) << "the mode was asked for often enough";
  EXPECT_EQ((Ids{kTorque, kStatus}), ids(command(tiller_state_hold, 1.0)));
}

TEST_F(Robot, SafeWithZeroTorqueIsIdleAndAHoldingTorqueIsNot) {
  for (std::uint32_t k = 0; k < ActuatorAxis::kBlindRequests; ++k) command(tiller_state_active, 10.0);
  std::vector<CanFrame> frames = command(tiller_state_safe, 2.0);
  EXPECT_EQ((Ids{kTorque, kStatus}), ids(frames)) << "a weight is held in closed loop";
  frames = command(tiller_state_safe, 0.0);
  ASSERT_EQ((Ids{kState, kTorque, kStatus}), ids(frames));
  EXPECT_EQ(1, frames[0].data[0]);
}

// Requirement: SR-21
TEST_F(Robot, NothingIsSentForACommandThatIsNotFinite) {
  EXPECT_TRUE(command(tiller_state_active, std::numeric_limits<double>::quiet_NaN()).empty());
  EXPECT_TRUE(command(tiller_state_active, -std::numeric_limits<double>::infinity()).empty());
  EXPECT_TRUE(command(tiller_state_active, 1e300).empty()) << "infinite as a float";
}

// ---- faults ----

// Requirement: SR-19
TEST_F(Robot, AnAxisErrorIsAFaultAtOnceAndWhileItLasts) {
  EXPECT_TRUE(receive(heartbeat(0x40, 1)));
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  EXPECT_TRUE(receive(heartbeat(0, 1)));
  EXPECT_EQ(tiller_status_ok, robot.fault());
  EXPECT_TRUE(receive(frame_of(kMotor, 3, words(0x1000000, 0))));  // Get_Error
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
}

// Requirement: SR-19
TEST_F(Robot, LeavingClosedLoopUnaskedIsAFaultAndNotAskedAgain) {
  command(tiller_state_active, 1.0);
  receive(heartbeat(0, 8));
  EXPECT_EQ(tiller_status_ok, robot.fault());
  receive(heartbeat(0, 1));
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  EXPECT_EQ((Ids{kTorque, kStatus}), ids(command(tiller_state_active, 1.0)));
  receive(heartbeat(0, 8));
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault()) << "latched: the robot was without torque meanwhile";
  CanFrame frames[TILLER_MAX_INPUTS];
  ASSERT_EQ(1u, robot.clear_faults(frames));
  EXPECT_EQ(kMotor << 5 | 0x18u, frames[0].id);
  EXPECT_EQ(tiller_status_ok, robot.fault());
  EXPECT_EQ((Ids{kMode, kState, kTorque, kStatus}), ids(command(tiller_state_active, 1.0)));
}

TEST_F(Robot, IdleOnRequestIsNoFault) {
  command(tiller_state_active, 1.0);
  receive(heartbeat(0, 8));
  command(tiller_state_safe, 0.0);
  receive(heartbeat(0, 1));
  EXPECT_EQ(tiller_status_ok, robot.fault());
}

TEST_F(Robot, ALostModeRequestIsRepeatedUntilItIsPlainThatTheMotorWillNot) {
  EXPECT_EQ((Ids{kMode, kState, kTorque, kStatus}), ids(command(tiller_state_active, 1.0)));
  for (std::uint32_t k = 0; k < ActuatorAxis::kArmReports; ++k) {
    receive(heartbeat(0, 1));
    EXPECT_EQ(tiller_status_ok, robot.fault()) << k;
    EXPECT_EQ((Ids{kMode, kState, kTorque, kStatus}), ids(command(tiller_state_active, 1.0))) << k;
  }
  receive(heartbeat(0, 1));
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  EXPECT_NE(std::string::npos, std::string(robot.fault_text()).find("does not enable"));
}

// Requirement: SR-19
TEST_F(Robot, ASilentMotorIsAFaultOnTheMeasurementsClock) {
  std::uint32_t sequence = 0, time_us = 0;
  const auto tick = [&] {
    measurement(sequence++, time_us);
    time_us += 100000;
  };
  receive(heartbeat(0, 1));
  for (int k = 0; k < 5; ++k) tick();  // 0 .. 0.4 s after the heartbeat
  EXPECT_EQ(tiller_status_ok, robot.fault());
  receive(heartbeat(0, 1));
  for (int k = 0; k < 6; ++k) tick();  // 0.5 .. 1.0 s, the heartbeat is from 0.5 s
  EXPECT_EQ(tiller_status_ok, robot.fault());
  tick();
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
  receive(heartbeat(0, 1));
  tick();
  EXPECT_EQ(tiller_status_ok, robot.fault()) << "it speaks again; what SAFE latches is the controller's";
}

TEST_F(Robot, AMotorThatWasNeverHeardIsAFaultToo) {
  for (std::uint32_t k = 0; k <= 5; ++k) measurement(k, 100000 * k);
  EXPECT_EQ(tiller_status_ok, robot.fault());
  measurement(6, 600000);
  EXPECT_EQ(tiller_status_actuator_fault, robot.fault());
}

// ---- layouts ----

TEST(CanLayoutError, EveryMistakeHasItsText) {
  const auto text_of = [](void (*change)(CanLayout&)) {
    CanLayout layout = cart();
    change(layout);
    const char* text = can_layout_error(layout);
    return std::string(text != nullptr ? text : "accepted");
  };
  const auto has = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_EQ("accepted", text_of([](CanLayout&) {}));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motor_count = 0; }), "1..16 motors"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motor_count = 17; }), "1..16 motors"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motor_count = 16; }), "at most 15 motors"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.channel_count = 0; }), "1..32 channels"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motors[0].node = 64; }), "from 0 to 63"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motors[0].node = kBoard; }), "sensor board"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motors[l.motor_count++] = l.motors[0]; }), "same node_id"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motors[0].wheel_radius_m = 0; }), "wheel_radius_m"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.motors[0].wheel_radius_m = std::nan(""); }), "wheel_radius_m"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.sensor_node = 64; }), "above 63"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.sensor_node = CanLayout::kNoBoard; }), "there is none"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.channels[0].index = 12; }), "channels 0..11"));
  EXPECT_TRUE(has(text_of([](CanLayout& l) { l.channels[0] = {CanSource::kMotorPosition, 1}; }), "not on the bus"));
}

}  // namespace
}  // namespace tiller
