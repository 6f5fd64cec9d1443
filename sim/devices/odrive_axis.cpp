#include "sim/devices/odrive_axis.hpp"

#include <cmath>

#include "tiller_odrive.h"

namespace tiller::sim {
namespace {

constexpr std::uint32_t axis_idle = 1, axis_closed_loop = 8;
constexpr std::uint32_t mode_torque = 1, input_passthrough = 1;

CanFrame frame_of(std::uint32_t node, std::uint32_t command, std::uint8_t length) {
  CanFrame frame;
  frame.id = can_id(node, command);
  frame.length = length;
  return frame;
}

}  // namespace

OdriveAxis::Event OdriveAxis::receive(const CanFrame& frame, CanFrames& replies) {
  if (can_node(frame.id) != node_) return Event::kNone;
  const std::uint32_t command = can_command(frame.id);
  if (frame.remote) {
    if (command != TILLER_ODRIVE_GET_ERROR_FRAME_ID) return ignore();
    replies.push_back(error_frame());
    return Event::kNone;
  }
  switch (command) {
    case TILLER_ODRIVE_ESTOP_FRAME_ID: fail(kEstopRequested); return Event::kDisarmed;
    case TILLER_ODRIVE_CLEAR_ERRORS_FRAME_ID: errors_ = 0; return Event::kNone;
    case TILLER_ODRIVE_SET_AXIS_STATE_FRAME_ID: return set_axis_state(frame);
    case TILLER_ODRIVE_SET_CONTROLLER_MODE_FRAME_ID: return set_controller_mode(frame);
    case TILLER_ODRIVE_SET_INPUT_TORQUE_FRAME_ID: return set_input_torque(frame);
    default: return ignore();
  }
}

void OdriveAxis::fail(std::uint32_t error) {
  errors_ |= error;
  disarm_reason_ = error;
  armed_ = false;
  torque_Nm_ = 0;
}

OdriveAxis::Event OdriveAxis::set_axis_state(const CanFrame& frame) {
  tiller_odrive_set_axis_state_t in{};
  if (tiller_odrive_set_axis_state_unpack(&in, frame.data.data(), frame.length) != 0) return ignore();
  if (in.axis_requested_state == axis_closed_loop) {
    armed_ = armed_ || errors_ == 0;
    return Event::kNone;
  }
  if (in.axis_requested_state != axis_idle) return ignore();
  armed_ = false;
  torque_Nm_ = 0;
  return Event::kDisarmed;
}

OdriveAxis::Event OdriveAxis::set_controller_mode(const CanFrame& frame) {
  tiller_odrive_set_controller_mode_t in{};
  if (tiller_odrive_set_controller_mode_unpack(&in, frame.data.data(), frame.length) != 0) return ignore();
  torque_mode_ = in.control_mode == mode_torque && in.input_mode == input_passthrough;
  return Event::kNone;
}

OdriveAxis::Event OdriveAxis::set_input_torque(const CanFrame& frame) {
  tiller_odrive_set_input_torque_t in{};
  if (tiller_odrive_set_input_torque_unpack(&in, frame.data.data(), frame.length) != 0) return ignore();
  if (!armed_ || !torque_mode_ || !std::isfinite(in.input_torque)) return ignore();
  torque_Nm_ = in.input_torque;
  return Event::kTorque;
}

CanFrame OdriveAxis::heartbeat() const {
  tiller_odrive_heartbeat_t out{};
  out.axis_error = errors_;
  out.axis_state = static_cast<std::uint8_t>(armed_ ? axis_closed_loop : axis_idle);
  CanFrame frame = frame_of(node_, TILLER_ODRIVE_HEARTBEAT_FRAME_ID, TILLER_ODRIVE_HEARTBEAT_LENGTH);
  tiller_odrive_heartbeat_pack(frame.data.data(), &out, frame.data.size());
  return frame;
}

CanFrame OdriveAxis::encoder_estimates(double position_rev, double velocity_rev_s) const {
  tiller_odrive_get_encoder_estimates_t out{};
  out.pos_estimate = static_cast<float>(position_rev);
  out.vel_estimate = static_cast<float>(velocity_rev_s);
  CanFrame frame =
      frame_of(node_, TILLER_ODRIVE_GET_ENCODER_ESTIMATES_FRAME_ID, TILLER_ODRIVE_GET_ENCODER_ESTIMATES_LENGTH);
  tiller_odrive_get_encoder_estimates_pack(frame.data.data(), &out, frame.data.size());
  return frame;
}

CanFrame OdriveAxis::error_frame() const {
  tiller_odrive_get_error_t out{};
  out.active_errors = errors_;
  out.disarm_reason = disarm_reason_;
  CanFrame frame = frame_of(node_, TILLER_ODRIVE_GET_ERROR_FRAME_ID, TILLER_ODRIVE_GET_ERROR_LENGTH);
  tiller_odrive_get_error_pack(frame.data.data(), &out, frame.data.size());
  return frame;
}

std::unique_ptr<DriveAxis> make_odrive_axis(const DriveOptions& options);
std::unique_ptr<DriveAxis> make_odrive_axis(const DriveOptions& options) {
  return std::make_unique<OdriveAxis>(options.node);
}

}  // namespace tiller::sim
