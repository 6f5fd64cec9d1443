// A stub: of ros2_control and rclcpp as much as examples/ros2_control uses, with their names and signatures (Jazzy), written
// for this test. It shows that the example compiles and what it computes, not that it runs in a ROS 2.
#pragma once

#include "rclcpp/rclcpp.hpp"

namespace rclcpp_lifecycle {

class State {};

class LifecycleNode {
 public:
  rclcpp::Parameter get_parameter(const std::string& name) const { return rclcpp::Parameter(parameters.at(name)); }
  rclcpp::Logger get_logger() const { return {}; }

  std::map<std::string, std::vector<std::string>> parameters;  // the stub's: filled by the test
};

}  // namespace rclcpp_lifecycle
