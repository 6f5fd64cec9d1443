#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "io/can_robot.hpp"
#include "sim/devices/can_frame.hpp"
#include "sim/devices/drive_axis.hpp"
#include "sim/servers/sensor_board.hpp"

namespace tiller {

constexpr std::uint32_t kMotor = 3, kBoard = 48;

inline CanFrame to_robot(const sim::CanFrame& frame) {
  CanFrame out;
  out.id = frame.id;
  out.length = frame.length;
  out.extended = frame.extended;
  out.fd = frame.fd;
  std::copy(frame.data.begin(), frame.data.end(), out.data);
  return out;
}

inline sim::CanFrame to_drive(const CanFrame& frame) {
  sim::CanFrame out;
  out.id = frame.id;
  out.length = frame.length;
  out.extended = frame.extended;
  out.fd = frame.fd;
  std::copy(frame.data, frame.data + 64, out.data.begin());
  return out;
}

/// One motor of that kind and a board of one channel.
inline CanLayout one_motor(ActuatorKind kind = ActuatorKind::odrive) {
  CanLayout layout;
  layout.motor_count = layout.channel_count = 1;
  layout.motors[0].node = kMotor;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.motors[0].drive.kind = kind;
  layout.sensor_node = kBoard;
  return layout;
}

/// Every protocol of actuators.def.
inline std::vector<ActuatorKind> every_actuator() {
  std::vector<ActuatorKind> kinds;
  for (int kind = 0; kind < static_cast<int>(ActuatorKind::count); ++kind)
    kinds.push_back(static_cast<ActuatorKind>(kind));
  return kinds;
}

inline std::unique_ptr<sim::DriveAxis> emulated(ActuatorKind kind, const char* reply = "plain") {
  sim::DriveOptions options;
  options.protocol = actuator_name(kind).word;
  options.node = kMotor;
  options.reply = reply;
  std::string error;
  auto drive = sim::make_drive(options, error);
  EXPECT_NE(nullptr, drive) << error;
  return drive;
}

/// The controller's side of a bus, and what it hears.
struct RobotBus {
  explicit RobotBus(const CanLayout& layout) {
    EXPECT_EQ(nullptr, can_layout_error(layout));
    robot.reset(layout);
  }

  void hear(const sim::CanFrames& frames, std::int64_t now_us = 0) {
    for (const sim::CanFrame& frame : frames)
      EXPECT_TRUE(robot.receive(to_robot(frame), now_us)) << "identifier " << frame.id;
  }
  /// Sent frames reach the drive, and its answers come back.
  void deliver(const CanFrame* frames, std::uint32_t count, sim::DriveAxis& drive, const sim::Shaft& shaft,
               std::int64_t now_us = 0) {
    for (std::uint32_t i = 0; i < count; ++i) {
      sim::CanFrames replies;
      drive.take(to_drive(frames[i]), shaft, replies);
      hear(replies, now_us);
    }
  }
  /// A reading of the board. False: no measurement came of it, or another one.
  bool reads(std::uint32_t sequence, bool is_protected, std::int64_t now_us) {
    for (const sim::CanFrame& frame : sim::sensor_frames(kBoard, {now_us, sequence, {0.25}}, is_protected))
      (void)robot.receive(to_robot(frame), now_us);
    tiller_measurement_t measurement;
    return robot.take(&measurement) && measurement.sequence == sequence && measurement.value[0] == 0.25;
  }

  CanRobot robot;
};

}  // namespace tiller
