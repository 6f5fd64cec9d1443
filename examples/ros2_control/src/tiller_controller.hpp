#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "tiller/tiller.h"

namespace tiller_ros2_control {

/// A ros2_control controller around tiller_tick. The robot file is compiled in (`tiller export`, see CMakeLists.txt);
/// the parameters say which interfaces of the hardware its measurements and inputs are:
///
///     state_interfaces: ["shoulder/position", "elbow/position"]   in the order of [measurement]
///     command_interfaces: ["shoulder/effort", "elbow/effort"]     in the order of the model's inputs
///
/// update() allocates nothing, takes no lock and prints nothing. It may run faster than the controller's period:
/// between two ticks the last command holds.
class TillerController : public controller_interface::ControllerInterface {
 public:
  controller_interface::CallbackReturn on_init() override;
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
  /// Writes the safe command.
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;
  controller_interface::return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) override;

 private:
  bool sizes_fit() const;
  void write(const double* command);

  tiller_config_t config_{};
  std::vector<std::string> state_names_, command_names_;
  std::vector<unsigned char> memory_;  // of the controller; allocated by on_configure
  tiller_t* tiller_ = nullptr;
  std::int64_t period_us_ = 0, next_tick_us_ = 0;
  std::uint32_t sequence_ = 0;
  bool begun_ = false;
};

}  // namespace tiller_ros2_control
