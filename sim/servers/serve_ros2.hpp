#pragma once

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

/// Serves the plant as a robot of ROS 2: JointState out, Float64MultiArray in; see serve(). In lockstep a command is the
/// answer to the measurement whose stamp is its source timestamp; commands say neither the controller's state nor the
/// number of its plan. A build without Cyclone DDS returns 1 with the packages to install.
int serve_ros2(Plant& plant, const Ros2Options& ros2, const ServeOptions& options, ServeReport& report);

}  // namespace tiller::sim
