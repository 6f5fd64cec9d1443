#pragma once

#include <memory>
#include <string>
#include <vector>

#include "sim/servers/serve.hpp"

namespace tiller::sim {

/// Where a channel of the plant stands in a JointState.
struct Ros2Channel {
  std::string joint;
  int field = 0;  ///< 0 position, 1 velocity, 2 effort
};

struct Ros2Options {
  std::string joint_states = "joint_states", commands;  ///< topics, as ROS 2 has them
  std::vector<Ros2Channel> channels;                    ///< (measurements)
};

/// A robot of ROS 2: JointState out, Float64MultiArray in. In lockstep a command is the answer to the measurement whose
/// stamp is its source timestamp; commands say neither the controller's state nor the number of its plan. Null with the
/// reason in `error`: in a build without Cyclone DDS the packages to install.
std::unique_ptr<PlantLink> open_ros2_link(const Ros2Options& ros2, bool lockstep, std::string& error);

/// Serves the plant over ROS 2's topics; see serve().
int serve_ros2(Plant& plant, const Ros2Options& ros2, const ServeOptions& options, ServeReport& report);

}  // namespace tiller::sim
