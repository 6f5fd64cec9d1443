// A stub: of ros2_control and rclcpp as much as examples/ros2_control uses, with their names and signatures (Jazzy), written
// for this test. It shows that the example compiles and what it computes, not that it runs in a ROS 2.
#pragma once

namespace hardware_interface {

class LoanedStateInterface {
 public:
  explicit LoanedStateInterface(const double* value) : value_(value) {}
  double get_value() const { return *value_; }

 private:
  const double* value_;
};

class LoanedCommandInterface {
 public:
  explicit LoanedCommandInterface(double* value) : value_(value) {}
  [[nodiscard]] bool set_value(double value) {
    *value_ = value;
    return true;
  }

 private:
  double* value_;
};

}  // namespace hardware_interface
