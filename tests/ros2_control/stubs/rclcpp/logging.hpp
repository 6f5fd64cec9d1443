// A stub: of ros2_control and rclcpp as much as examples/ros2_control uses, with their names and signatures (Jazzy), written
// for this test. It shows that the example compiles and what it computes, not that it runs in a ROS 2.
#pragma once

#include <cstdio>

#include "rclcpp/rclcpp.hpp"

#define RCLCPP_ERROR(logger, ...)            \
  do {                                       \
    (void)(logger);                          \
    (void)std::fprintf(stderr, __VA_ARGS__); \
    (void)std::fputc('\n', stderr);          \
  } while (false)
