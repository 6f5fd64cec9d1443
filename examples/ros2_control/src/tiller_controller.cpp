#include "tiller_controller.hpp"

#include <cmath>

#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/logging.hpp"

/// Written by `tiller export ROBOT --prefix robot`.
extern "C" tiller_config_t robot_config(void);

namespace tiller_ros2_control {

using controller_interface::CallbackReturn;
using controller_interface::interface_configuration_type;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

CallbackReturn TillerController::on_init() {
  auto_declare<std::vector<std::string>>("state_interfaces", {});
  auto_declare<std::vector<std::string>>("command_interfaces", {});
  return CallbackReturn::SUCCESS;
}

InterfaceConfiguration TillerController::command_interface_configuration() const {
  return {interface_configuration_type::INDIVIDUAL, command_names_};
}

InterfaceConfiguration TillerController::state_interface_configuration() const {
  return {interface_configuration_type::INDIVIDUAL, state_names_};
}

bool TillerController::sizes_fit() const {
  if (state_names_.size() == config_.measurement_count && command_names_.size() == config_.model->input_count)
    return true;
  RCLCPP_ERROR(
      get_node()->get_logger(),
      "the robot file has %u measurements and %u inputs; state_interfaces lists %zu and command_interfaces %zu",
      config_.measurement_count, config_.model->input_count, state_names_.size(), command_names_.size());
  return false;
}

CallbackReturn TillerController::on_configure(const rclcpp_lifecycle::State&) {
  config_ = robot_config();
  state_names_ = get_node()->get_parameter("state_interfaces").as_string_array();
  command_names_ = get_node()->get_parameter("command_interfaces").as_string_array();
  const char* field = nullptr;
  const tiller_status_t status = tiller_config_check(&config_, &field);
  if (status != tiller_status_ok) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s: %s", field != nullptr ? field : "robot file",
                 tiller_status_text(status));
    return CallbackReturn::ERROR;
  }
  if (!sizes_fit()) return CallbackReturn::ERROR;
  const std::size_t size = tiller_size(&config_);
  memory_.assign(size + TILLER_ALIGNMENT, 0);
  const auto base = reinterpret_cast<std::uintptr_t>(memory_.data());
  const std::size_t offset = (TILLER_ALIGNMENT - base % TILLER_ALIGNMENT) % TILLER_ALIGNMENT;
  if (tiller_init(&tiller_, &config_, nullptr, memory_.data() + offset, size) != tiller_status_ok)
    return CallbackReturn::ERROR;
  period_us_ = std::llround(1e6 * config_.period_s);
  return CallbackReturn::SUCCESS;
}

/// What stood in HOLD or SAFE begins anew: whoever activates a controller has looked.
CallbackReturn TillerController::on_activate(const rclcpp_lifecycle::State&) {
  begun_ = false;
  if (tiller_reset(tiller_) != tiller_status_ok || tiller_arm(tiller_) != tiller_status_ok)
    return CallbackReturn::ERROR;
  return CallbackReturn::SUCCESS;
}

CallbackReturn TillerController::on_deactivate(const rclcpp_lifecycle::State&) {
  (void)tiller_disarm(tiller_);
  write(config_.safety.safe_command);
  return CallbackReturn::SUCCESS;
}

/// set_value answers in newer versions of ros2_control whether it had the lock; the next update writes again.
void TillerController::write(const double* command) {
  for (std::size_t i = 0; i < command_interfaces_.size(); ++i) (void)command_interfaces_[i].set_value(command[i]);
}

return_type TillerController::update(const rclcpp::Time& time, const rclcpp::Duration&) {
  const std::int64_t now_us = time.nanoseconds() / 1000;
  if (begun_ && now_us < next_tick_us_) return return_type::OK;
  tiller_measurement_t measurement{};
  measurement.stamp_us = now_us;  // the hardware has been read just before
  measurement.sequence = sequence_++;
  for (std::size_t i = 0; i < state_interfaces_.size(); ++i) measurement.value[i] = state_interfaces_[i].get_value();
  tiller_command_t command;
  (void)tiller_tick(tiller_, now_us, &measurement, &command);  // the command is safe whatever it returns
  next_tick_us_ = begun_ ? next_tick_us_ + period_us_ : now_us + period_us_;
  if (next_tick_us_ <= now_us) next_tick_us_ = now_us + period_us_;  // late: no burst
  begun_ = true;
  write(command.value);
  return return_type::OK;
}

}  // namespace tiller_ros2_control

PLUGINLIB_EXPORT_CLASS(tiller_ros2_control::TillerController, controller_interface::ControllerInterface)
