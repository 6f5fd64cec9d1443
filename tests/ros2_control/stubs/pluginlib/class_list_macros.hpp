// A stub: of ros2_control and rclcpp as much as examples/ros2_control uses, with their names and signatures (Jazzy), written
// for this test. It shows that the example compiles and what it computes, not that it runs in a ROS 2.
#pragma once

#include <memory>

/// The stub's loader: the one class of the library, by the names of the plugin description.
#define PLUGINLIB_EXPORT_CLASS(Class, Base)                                     \
  std::unique_ptr<Base> load_plugin(const char* class_type, const char* base);  \
  std::unique_ptr<Base> load_plugin(const char* class_type, const char* base) { \
    const std::string type = class_type, base_type = base;                      \
    if (type != #Class || base_type != #Base) return nullptr;                   \
    return std::make_unique<Class>();                                           \
  }
