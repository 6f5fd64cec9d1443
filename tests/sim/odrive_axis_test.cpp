#include "sim/devices/odrive_axis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

// The protocol as bytes: written by hand from ODrive's CANSimple, not by the codec that the axis uses.

namespace tiller::sim {
namespace {

constexpr std::uint32_t node = 5;
using Event = OdriveAxis::Event;

CanFrame frame(std::uint32_t command, std::vector<std::uint8_t> bytes) {
  CanFrame f;
  f.id = node << 5 | command;
  f.length = static_cast<std::uint8_t>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), f.data.begin());
  return f;
}

CanFrame torque(float value) {
  std::vector<std::uint8_t> bytes(4);
  std::memcpy(bytes.data(), &value, 4);  // little-endian IEEE 754, as every machine that runs this test
  return frame(0x0e, bytes);
}

const CanFrame arm = frame(0x07, {8, 0, 0, 0});
const CanFrame idle = frame(0x07, {1, 0, 0, 0});
const CanFrame torque_mode = frame(0x0b, {1, 0, 0, 0, 1, 0, 0, 0});
const CanFrame estop = frame(0x02, {});
const CanFrame clear_errors = frame(0x18, {0});

struct Bench {
  OdriveAxis axis{node};
  CanFrames replies;
  Event send(const CanFrame& f) { return axis.receive(f, replies); }
  std::uint32_t reported_error() const {
    std::uint32_t error;
    std::memcpy(&error, axis.heartbeat().data.data(), 4);
    return error;
  }
  int reported_state() const { return axis.heartbeat().data[4]; }
  void make_ready() {
    send(torque_mode);
    send(arm);
  }
};

TEST(OdriveAxis, StartsIdleAndArmsOnRequest) {
  Bench b;
  EXPECT_EQ(b.axis.heartbeat().id, node << 5 | 1u);
  EXPECT_EQ(b.axis.heartbeat().length, 8);
  EXPECT_EQ(b.reported_state(), 1);
  EXPECT_EQ(b.send(torque(1)), Event::kNone);  // idle
  b.make_ready();
  EXPECT_EQ(b.reported_state(), 8);
  EXPECT_EQ(b.reported_error(), 0u);
  EXPECT_EQ(b.send(torque(0.25f)), Event::kTorque);
  EXPECT_EQ(b.axis.torque_Nm(), 0.25);
  EXPECT_EQ(b.send(idle), Event::kDisarmed);
  EXPECT_EQ(b.axis.torque_Nm(), 0);
  EXPECT_EQ(b.reported_state(), 1);
}

TEST(OdriveAxis, TakesTorqueOnlyInTorqueMode) {
  Bench b;
  b.send(arm);
  EXPECT_EQ(b.send(torque(1)), Event::kNone);  // position mode, as from the factory
  b.send(torque_mode);
  EXPECT_EQ(b.send(torque(1)), Event::kTorque);
  b.send(frame(0x0b, {2, 0, 0, 0, 1, 0, 0, 0}));  // velocity mode
  EXPECT_EQ(b.send(torque(1)), Event::kNone);
  b.send(frame(0x0b, {1, 0, 0, 0, 2, 0, 0, 0}));  // input through a ramp
  EXPECT_EQ(b.send(torque(1)), Event::kNone);
}

TEST(OdriveAxis, EstopLatchesUntilErrorsAreCleared) {
  Bench b;
  b.make_ready();
  EXPECT_EQ(b.send(estop), Event::kDisarmed);
  EXPECT_EQ(b.reported_error(), 0x2000000u);
  b.send(arm);
  EXPECT_EQ(b.reported_state(), 1);  // an axis with errors does not arm
  b.send(clear_errors);
  EXPECT_EQ(b.reported_error(), 0u);
  EXPECT_EQ(b.reported_state(), 1);  // nor does it by itself
  b.send(arm);
  EXPECT_EQ(b.reported_state(), 8);
}

TEST(OdriveAxis, WatchdogDisarmsAnArmedAxisOnly) {
  Bench b;
  b.axis.expire_watchdog();
  EXPECT_EQ(b.reported_error(), 0u);
  b.make_ready();
  b.send(torque(2));
  b.axis.expire_watchdog();
  EXPECT_EQ(b.reported_error(), 0x1000000u);
  EXPECT_EQ(b.reported_state(), 1);
  EXPECT_EQ(b.send(torque(2)), Event::kNone);
}

TEST(OdriveAxis, TellsItsErrorsWhenAsked) {
  Bench b;
  b.make_ready();
  b.axis.expire_watchdog();
  b.send(clear_errors);
  CanFrame question = frame(0x03, {});
  question.remote = true;
  b.send(question);
  ASSERT_EQ(b.replies.size(), 1u);
  EXPECT_EQ(b.replies[0].id, node << 5 | 3u);
  std::uint32_t words[2];
  std::memcpy(words, b.replies[0].data.data(), 8);
  EXPECT_EQ(words[0], 0u);
  EXPECT_EQ(words[1], 0x1000000u);  // why it was disarmed outlives the error
}

TEST(OdriveAxis, EncoderEstimatesAreTwoFloats) {
  const CanFrame f = OdriveAxis(node).encoder_estimates(1.5, -0.25);
  EXPECT_EQ(f.id, node << 5 | 9u);
  float values[2];
  std::memcpy(values, f.data.data(), 8);
  EXPECT_EQ(values[0], 1.5f);
  EXPECT_EQ(values[1], -0.25f);
}

TEST(OdriveAxis, IgnoresWhatItCannotMean) {
  Bench b;
  b.make_ready();
  ASSERT_EQ(b.send(torque(0.5f)), Event::kTorque);
  EXPECT_EQ(b.send(torque(std::nanf(""))), Event::kNone);
  EXPECT_EQ(b.send(torque(std::numeric_limits<float>::infinity())), Event::kNone);
  EXPECT_EQ(b.send(frame(0x0e, {1, 2})), Event::kNone);        // short
  EXPECT_EQ(b.send(frame(0x07, {3, 0, 0, 0})), Event::kNone);  // a state that this axis does not have
  EXPECT_EQ(b.send(frame(0x1f, {1, 2, 3, 4})), Event::kNone);  // unknown command
  EXPECT_EQ(b.axis.ignored_frames(), 5u);
  CanFrame foreign = torque(9);
  foreign.id += 32;  // another node: not even counted
  EXPECT_EQ(b.send(foreign), Event::kNone);
  EXPECT_EQ(b.axis.ignored_frames(), 5u);
  EXPECT_EQ(b.axis.torque_Nm(), 0.5);
  EXPECT_EQ(b.reported_state(), 8);
}

}  // namespace
}  // namespace tiller::sim
