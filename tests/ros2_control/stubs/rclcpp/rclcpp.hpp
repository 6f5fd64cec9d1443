// A stub: of ros2_control and rclcpp as much as examples/ros2_control uses, with their names and signatures (Jazzy), written
// for this test. It shows that the example compiles and what it computes, not that it runs in a ROS 2.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace rclcpp {

class Time {
 public:
  explicit Time(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }

 private:
  std::int64_t nanoseconds_;
};

class Duration {
 public:
  explicit Duration(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }

 private:
  std::int64_t nanoseconds_;
};

struct Logger {};

class Parameter {
 public:
  explicit Parameter(std::vector<std::string> value) : value_(std::move(value)) {}
  std::vector<std::string> as_string_array() const { return value_; }

 private:
  std::vector<std::string> value_;
};

}  // namespace rclcpp
