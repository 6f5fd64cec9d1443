// Run by in_network_namespace.sh on a loopback that nobody else sees, with a CYCLONEDDS_URI that keeps to it. The other
// side is a second participant of this process; faults_test.py and lockstep_test.py have independent ones.
#include "ros2/ros2_transport.hpp"

#include <gtest/gtest.h>
#include <poll.h>

#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "io/monotonic_clock.hpp"
#include "ros2/ros2_wire.hpp"
#include "ros2_messages.h"

namespace tiller {
namespace {

using JointState = sensor_msgs_msg_dds__JointState_;
using Imu = sensor_msgs_msg_dds__Imu_;
using Odometry = nav_msgs_msg_dds__Odometry_;
using Efforts = std_msgs_msg_dds__Float64MultiArray_;

constexpr int kPatienceMs = 60000;  // only ever waited for in full by a test that fails
constexpr std::int64_t kMs = 1000000;

template <class Message>
void set_stamp(Message& message, std::int64_t ns) {
  message.header.stamp.sec = static_cast<std::int32_t>(ns / 1000000000);
  message.header.stamp.nanosec = static_cast<std::uint32_t>(ns % 1000000000);
  static char frame[] = "base";
  message.header.frame_id = frame;
}

std::int64_t now_ns() { return 1000 * realtime_us(); }

class Ros2 : public ::testing::Test {
 protected:
  void SetUp() override {
    options_.measurement_count = 2;
    options_.input_count = 2;
    options_.commands = "arm/commands";
    ASSERT_TRUE(ros2_parse_source("position:shoulder", &options_.source[0]));
    ASSERT_TRUE(ros2_parse_source("velocity:elbow", &options_.source[1]));
  }
  void TearDown() override {
    kRos2Transport.close(&transport_);
    if (peer_ > 0) (void)dds_delete(peer_);
  }

  void open() {
    OpenError error;
    ASSERT_EQ(tiller_status_ok, ros2_transport_open(&transport_, options_, &error)) << error.text;
    peer_ = ros2_participant();
    ASSERT_GT(peer_, 0);
    states_ = ros2_writer(peer_, Ros2Type::kJointState, "rt/joint_states");
    efforts_ = ros2_reader(peer_, Ros2Type::kEffort, "rt/arm/commands", Ros2Qos::kReliable, nullptr);
    ASSERT_GT(states_, 0);
    ASSERT_GT(efforts_, 0);
    meet(states_);
  }

  /// Until the transport reads this writer's topic, and the peer the commands'.
  void meet(dds_entity_t writer) {
    dds_publication_matched_status_t out{};
    dds_subscription_matched_status_t in{};
    for (int tries = 0; tries < kPatienceMs / 5 && (out.current_count == 0 || in.current_count == 0); ++tries) {
      dds_sleepfor(5 * kMs);
      ASSERT_EQ(DDS_RETCODE_OK, dds_get_publication_matched_status(writer, &out));
      ASSERT_EQ(DDS_RETCODE_OK, dds_get_subscription_matched_status(efforts_, &in));
    }
    ASSERT_EQ(1u, out.current_count);
    ASSERT_EQ(1u, in.current_count);
  }

  void write(std::int64_t stamp_ns, std::vector<const char*> names, std::vector<double> position,
             std::vector<double> velocity) {
    JointState message{};
    set_stamp(message, stamp_ns);
    message.name._buffer = const_cast<char**>(names.data());
    message.name._length = static_cast<std::uint32_t>(names.size());
    message.position._buffer = position.data();
    message.position._length = static_cast<std::uint32_t>(position.size());
    message.velocity._buffer = velocity.data();
    message.velocity._length = static_cast<std::uint32_t>(velocity.size());
    ASSERT_EQ(DDS_RETCODE_OK, dds_write(states_, &message));
  }
  void write(std::int64_t stamp_ns, double value = 0.5) {
    write(stamp_ns, {"gripper", "elbow", "shoulder"}, {0, 1, value}, {0, -value, 3});
  }

  /// Polls as the executive does, sleeping on the descriptor in between, until a message has come, good or not.
  tiller_status_t take() {
    const auto seen = [this] {
      const tiller_transport_counters_t& c = transport_.counters;
      return c.received + c.bad_messages + c.dropped_old + transport_.repeated_answers;
    };
    const std::uint64_t before = seen();
    for (;;) {
      const tiller_status_t status = kRos2Transport.poll(&transport_, &measurement_);
      if (status != tiller_status_no_new_measurement || seen() > before) return status;
      pollfd wanted = {kRos2Transport.descriptor(&transport_), POLLIN, 0};
      if (::poll(&wanted, 1, kPatienceMs) <= 0) return status;
    }
  }

  tiller_status_t send(double first, double second) {
    tiller_command_t command{};
    command.value[0] = first;
    command.value[1] = second;
    return kRos2Transport.send(&transport_, &command);
  }

  /// The next command at the peer; false: none came.
  bool hear(std::vector<double>& values, std::int64_t& source_ns) {
    for (int tries = 0; tries < kPatienceMs; ++tries) {
      void* sample = nullptr;
      dds_sample_info_t info;
      if (dds_take(efforts_, &sample, &info, 1, 1) == 1) {
        const auto* message = static_cast<const Efforts*>(sample);
        values.assign(message->data._buffer, message->data._buffer + message->data._length);
        source_ns = info.source_timestamp;
        (void)dds_return_loan(efforts_, &sample, 1);
        return true;
      }
      dds_sleepfor(kMs);
    }
    return false;
  }

  Ros2Options options_;
  Ros2Transport transport_;
  dds_entity_t peer_ = 0, states_ = 0, efforts_ = 0;
  tiller_measurement_t measurement_{};
};

TEST_F(Ros2, JointsAreFoundByTheirNames) {
  open();
  const std::int64_t before_us = monotonic_us() - 3000;
  write(now_ns() - 3 * kMs);
  ASSERT_EQ(tiller_status_ok, take());
  EXPECT_EQ(0.5, measurement_.value[0]);
  EXPECT_EQ(-0.5, measurement_.value[1]);
  // the age by the system clock is the age by the monotonic one; they are read microseconds apart
  EXPECT_GE(measurement_.stamp_us, before_us - 100);
  EXPECT_LE(measurement_.stamp_us, monotonic_us() - 3000 + 100);
}

TEST_F(Ros2, AMissingJointIsNamed) {
  open();
  write(now_ns(), {"wrist", "shoulder"}, {1, 2}, {3, 4});
  EXPECT_EQ(tiller_status_no_new_measurement, take());
  EXPECT_EQ(1u, transport_.counters.bad_messages);
  ASSERT_NE(nullptr, transport_.refused_source);
  EXPECT_STREQ("elbow", transport_.refused_source->joint);
  EXPECT_STREQ("wrist, shoulder", transport_.seen);
  write(now_ns(), {"elbow", "shoulder"}, {1, 2}, {});
  EXPECT_EQ(tiller_status_no_new_measurement, take());
  ASSERT_NE(nullptr, transport_.refused_source);
  EXPECT_STREQ("has no such value of the joint", transport_.refusal);
  write(now_ns());
  EXPECT_EQ(tiller_status_ok, take());
}

TEST_F(Ros2, OldAndRepeatedStampsAreRefusedAndOnesAheadBarNothing) {
  open();
  const std::int64_t first_ns = now_ns();
  write(first_ns);
  ASSERT_EQ(tiller_status_ok, take());
  for (const std::int64_t stamp_ns : {first_ns, first_ns - kMs}) {
    write(stamp_ns);
    EXPECT_EQ(tiller_status_no_new_measurement, take());
  }
  EXPECT_EQ(2u, transport_.counters.dropped_old);
  write(now_ns() + 3600000 * kMs);
  ASSERT_EQ(tiller_status_ok, take()) << "passed on, for the controller to reject by name";
  EXPECT_GT(measurement_.stamp_us, monotonic_us() + 3000000);
  write(now_ns());
  EXPECT_EQ(tiller_status_ok, take());
}

TEST_F(Ros2, AStampThatIsNoTimeIsRefused) {
  open();
  write(0);
  EXPECT_EQ(tiller_status_no_new_measurement, take());
  EXPECT_STREQ("header.stamp is zero; set stamp_on_arrival = true", transport_.refusal);
  JointState message{};
  set_stamp(message, now_ns());
  message.header.stamp.nanosec = 4000000000u;
  ASSERT_EQ(DDS_RETCODE_OK, dds_write(states_, &message));
  EXPECT_EQ(tiller_status_no_new_measurement, take());
  EXPECT_STREQ("a header.stamp is no time", transport_.refusal);
  EXPECT_EQ(2u, transport_.counters.bad_messages);
}

TEST_F(Ros2, TimesOfArrivalReplaceAForeignClock) {
  options_.stamp_on_arrival = true;
  open();
  for (const std::int64_t stamp_ns : {std::int64_t{0}, 5 * kMs, 6 * kMs}) {
    const std::int64_t before_us = monotonic_us();
    write(stamp_ns);
    ASSERT_EQ(tiller_status_ok, take());
    EXPECT_GE(measurement_.stamp_us, before_us);
    EXPECT_LE(measurement_.stamp_us, monotonic_us());
  }
}

TEST_F(Ros2, WhatWaitedTooLongIsRefused) {
  options_.max_wait_us = 1;
  open();
  write(now_ns());
  dds_sleepfor(20 * kMs);
  EXPECT_EQ(tiller_status_no_new_measurement, take());
  EXPECT_STREQ("a message waited too long before it was read", transport_.refusal);
}

TEST_F(Ros2, NotANumberIsPassedOnToTheController) {
  open();
  write(now_ns(), std::nan(""));
  ASSERT_EQ(tiller_status_ok, take());
  EXPECT_TRUE(std::isnan(measurement_.value[0]));
}

TEST_F(Ros2, TheNewestWins) {
  open();
  for (int k = 1; k <= 3; ++k) write(now_ns(), k);
  while (transport_.counters.received < 3) ASSERT_EQ(tiller_status_ok, take());
  EXPECT_EQ(3.0, measurement_.value[0]);
}

// Requirement: SR-21
TEST_F(Ros2, CommandsArriveWholeAndFinite) {
  open();
  EXPECT_EQ(tiller_status_command_not_finite, send(1, std::nan("")));
  EXPECT_EQ(tiller_status_ok, send(1.5, -2));
  std::vector<double> values;
  std::int64_t source_ns = 0;
  ASSERT_TRUE(hear(values, source_ns));
  EXPECT_EQ((std::vector<double>{1.5, -2}), values);
  EXPECT_EQ(1u, transport_.counters.sent);
}

TEST_F(Ros2, InLockstepACommandNamesItsMeasurementAndARepetitionGetsItAgain) {
  options_.lockstep = true;
  open();
  std::vector<double> values;
  std::int64_t source_ns = 0;
  for (int k = 1; k <= 20; ++k) {
    const std::int64_t stamp_ns = 1000 * kMs + 20 * kMs * k;
    write(stamp_ns, k);
    ASSERT_EQ(tiller_status_ok, take());
    EXPECT_EQ(stamp_ns / 1000, measurement_.stamp_us);
    ASSERT_EQ(tiller_status_ok, send(k, 0));
    ASSERT_TRUE(hear(values, source_ns));
    EXPECT_EQ(stamp_ns, source_ns);
    write(stamp_ns, k);
    EXPECT_EQ(tiller_status_no_new_measurement, take());
    ASSERT_TRUE(hear(values, source_ns));
    EXPECT_EQ(stamp_ns, source_ns);
    EXPECT_EQ(k, values[0]);
  }
  EXPECT_EQ(20u, transport_.counters.received);
  EXPECT_EQ(20u, transport_.repeated_answers);
  write(1000 * kMs);
  EXPECT_EQ(tiller_status_no_new_measurement, take()) << "the past is not new, however long nothing came";
}

TEST_F(Ros2, SeveralMessagesMakeOneMeasurement) {
  options_.measurement_count = 4;
  ASSERT_TRUE(ros2_parse_source("imu:angular_velocity.z", &options_.source[2]));
  ASSERT_TRUE(ros2_parse_source("odometry:yaw", &options_.source[3]));
  open();
  const dds_entity_t imu = ros2_writer(peer_, Ros2Type::kImu, "rt/imu");
  const dds_entity_t odometry = ros2_writer(peer_, Ros2Type::kOdometry, "rt/odom");
  meet(imu);
  meet(odometry);
  const std::int64_t stamp_ns = now_ns();
  Imu turning{};
  set_stamp(turning, stamp_ns);
  turning.angular_velocity.z = 0.25;
  ASSERT_EQ(DDS_RETCODE_OK, dds_write(imu, &turning));
  Odometry pose{};
  static char child[] = "base";
  pose.child_frame_id = child;
  set_stamp(pose, stamp_ns - 500 * kMs);
  pose.pose.pose.orientation.z = std::sin(0.6);
  pose.pose.pose.orientation.w = std::cos(0.6);
  ASSERT_EQ(DDS_RETCODE_OK, dds_write(odometry, &pose));
  while (!transport_.reader[1].has_numbers || !transport_.reader[2].has_numbers)
    ASSERT_EQ(tiller_status_no_new_measurement, kRos2Transport.poll(&transport_, &measurement_));
  write(stamp_ns);
  ASSERT_EQ(tiller_status_ok, take());
  EXPECT_EQ(0.25, measurement_.value[2]);
  EXPECT_TRUE(std::isnan(measurement_.value[3])) << "half a second old";
  set_stamp(pose, stamp_ns + kMs);
  ASSERT_EQ(DDS_RETCODE_OK, dds_write(odometry, &pose));
  while (transport_.reader[2].time_us != (stamp_ns + kMs) / 1000) (void)kRos2Transport.poll(&transport_, &measurement_);
  write(stamp_ns + 2 * kMs);
  ASSERT_EQ(tiller_status_ok, take());
  EXPECT_NEAR(1.2, measurement_.value[3], 1e-12);
}

TEST_F(Ros2, SilenceIsExplained) {
  OpenError error;
  ASSERT_EQ(tiller_status_ok, ros2_transport_open(&transport_, options_, &error)) << error.text;
  char text[300];
  ros2_silence(&transport_, text, sizeof text);
  EXPECT_STREQ("nobody publishes rt/joint_states in this domain", text);
  peer_ = ros2_participant();
  (void)ros2_writer(peer_, Ros2Type::kImu, "rt/joint_states");
  const std::string wanted =
      "a publisher of rt/joint_states has the type sensor_msgs::msg::dds_::Imu_, not "
      "sensor_msgs::msg::dds_::JointState_";
  for (int tries = 0; tries < kPatienceMs / 5 && wanted != text; ++tries) {
    dds_sleepfor(5 * kMs);
    ros2_silence(&transport_, text, sizeof text);
  }
  EXPECT_EQ(wanted, text);
}

TEST(Ros2Open, ErrorsTellWhatIsWrong) {
  Ros2Transport transport;
  Ros2Options options;
  OpenError error;
  EXPECT_EQ(tiller_status_bad_dimension, ros2_transport_open(&transport, options, &error));
  options.measurement_count = options.input_count = 1;
  ASSERT_TRUE(ros2_source_of_name("angle_rad", &options.source[0]));
  for (const char* name : {"", "/", "a//b", "2nd/commands", "arm/commands/", "arm-1/commands"}) {
    options.commands = name;
    EXPECT_EQ(tiller_status_bad_message, ros2_transport_open(&transport, options, &error)) << name;
    EXPECT_NE(nullptr, std::strstr(error.text, "is no name of a topic")) << error.text;
  }
  tiller_measurement_t measurement;
  EXPECT_EQ(tiller_status_transport_closed, kRos2Transport.poll(&transport, &measurement));
}

TEST(Ros2Sources, AreWordsOfTheRobotFile) {
  Ros2Source source;
  ASSERT_TRUE(ros2_parse_source("effort:left_knee", &source));
  EXPECT_EQ(2, source.field);
  EXPECT_STREQ("left_knee", source.joint);
  ASSERT_TRUE(ros2_parse_source("odometry:linear.x", &source));
  EXPECT_EQ(Ros2Message::kOdometry, source.message);
  EXPECT_STREQ("linear.x", kOdometryFields[source.field]);
  const std::string long_joint = "position:" + std::string(64, 'j');
  for (const char* wrong : {"", "position", "position:", "imu:position.x", "odometry:", "torque:a", long_joint.c_str()})
    EXPECT_FALSE(ros2_parse_source(wrong, &source)) << wrong;
  ASSERT_TRUE(ros2_source_of_name("hip_rad_s", &source));
  EXPECT_STREQ("hip", source.joint);
  EXPECT_EQ(1, source.field);
  ASSERT_TRUE(ros2_source_of_name("rail_m", &source));
  EXPECT_EQ(0, source.field);
  for (const char* wrong : {"_rad", "current_A", "speed"}) EXPECT_FALSE(ros2_source_of_name(wrong, &source)) << wrong;
}

TEST(Ros2Sources, AnglesAreThoseOfTheFixedAxes) {
  const double roll = 0.3, pitch = -0.4, yaw = 2.0;
  const double cr = std::cos(roll / 2), sr = std::sin(roll / 2), cp = std::cos(pitch / 2), sp = std::sin(pitch / 2),
               cy = std::cos(yaw / 2), sy = std::sin(yaw / 2);
  double angles[3];
  ros2_angles({sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
               cr * cp * cy + sr * sp * sy},
              angles);
  EXPECT_NEAR(roll, angles[0], 1e-14);
  EXPECT_NEAR(pitch, angles[1], 1e-14);
  EXPECT_NEAR(yaw, angles[2], 1e-14);
}

}  // namespace
}  // namespace tiller
