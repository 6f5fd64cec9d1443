#pragma once

#include <memory>
#include <string>

#include "sim/devices/drive_axis.hpp"
#include "sim/servers/serve.hpp"

namespace tiller::sim {

/// A bus with one motor driver that drives the plant, and one sensor board that reads its encoders.
struct CanOptions {
  std::string interface = "vcan0";
  DriveOptions drive;
  std::uint32_t sensor_node = 48;  ///< 0..63, another one
  bool protected_frames = true;    ///< the board sends the layout with a CRC
  /// Motor torque to the plant's command: force_N = torque_Nm / wheel_radius_m. Plants that take a torque are
  /// driven directly: 1. Negative: the
  /// motor is mounted mirrored.
  double wheel_radius_m = 1.0;
};

/// Opens the bus. Null with the reason in error.
std::unique_ptr<PlantLink> open_can_link(const CanOptions& options, const Plant& plant, std::string& error);

/// Serves the plant over CAN; see serve(). In lockstep the controller's status frame is the answer that
/// simulated time waits for; torques act when they arrive.
int serve_can(Plant& plant, const CanOptions& can, const ServeOptions& options, ServeReport& report);

}  // namespace tiller::sim
