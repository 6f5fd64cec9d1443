#pragma once

#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Topics of [transport]; where the file names none, they stand below the robot's name, in letters that ROS 2 allows:
/// "cart-pole" is cart_pole/commands.
std::string ros2_commands_topic(const RobotFile& robot);
std::string ros2_trajectory_topic(const RobotFile& robot);
/// What the command is called in ROS 2's graph: "tiller_cart_pole".
std::string ros2_node_name(const RobotFile& robot);

}  // namespace tiller::tools
