#include "io/can_robot.hpp"

#include <cmath>
#include <cstring>
#include <limits>

extern "C" {
#include "tiller_odrive.h"
#include "tiller_sensors.h"
}

namespace tiller {
namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr std::uint32_t kNodes = 64;  // 6 bits of the identifier
constexpr std::uint32_t kBoardChannels = 12;

std::uint32_t can_id(std::uint32_t node, std::uint32_t command) { return node << 5 | command; }

const char* motor_error(const CanLayout& layout, std::uint32_t i) {
  const CanMotor& motor = layout.motors[i];
  if (motor.node >= kNodes) return "a motor's node_id is above 63";
  if (motor.node == layout.sensor_node) return "a motor and the sensor board have the same node_id";
  for (std::uint32_t j = 0; j < i; ++j)
    if (layout.motors[j].node == motor.node) return "two motors have the same node_id";
  if (!std::isfinite(motor.wheel_radius_m) || motor.wheel_radius_m == 0.0)
    return "a wheel_radius_m is zero or not finite (1 for an input that is a torque at the shaft)";
  return nullptr;
}

const char* channel_error(const CanLayout& layout, const CanChannel& channel) {
  switch (channel.source) {
    case CanSource::kSensor:
      if (layout.sensor_node == CanLayout::kNoBoard) return "a channel reads the sensor board, and there is none";
      return channel.index < kBoardChannels ? nullptr : "a sensor board has channels 0..11";
    case CanSource::kMotorPosition:
    case CanSource::kMotorVelocity:
      return channel.index < layout.motor_count ? nullptr : "a channel reads a motor that is not on the bus";
  }
  return "a channel's source is unknown";
}

}  // namespace

const char* can_layout_error(const CanLayout& layout) {
  if (layout.motor_count < 1 || layout.motor_count > TILLER_MAX_INPUTS) return "there must be 1..4 motors";
  if (layout.channel_count < 1 || layout.channel_count > TILLER_MAX_MEASUREMENTS) return "there must be 1..12 channels";
  if (layout.sensor_node >= kNodes && layout.sensor_node != CanLayout::kNoBoard)
    return "the sensor board's node_id is above 63";
  for (std::uint32_t i = 0; i < layout.motor_count; ++i)
    if (const char* error = motor_error(layout, i)) return error;
  for (std::uint32_t i = 0; i < layout.channel_count; ++i)
    if (const char* error = channel_error(layout, layout.channels[i])) return error;
  return nullptr;
}

void CanRobot::reset(const CanLayout& layout) {
  *this = CanRobot();
  layout_ = layout;
  for (std::uint32_t i = 0; i < layout.channel_count; ++i) {
    const CanChannel& channel = layout.channels[i];
    if (channel.source == CanSource::kSensor)
      needed_values_ |= 1u << channel.index;
    else
      needed_estimates_ |= 1u << channel.index;
  }
}

// ---- frames in ----

bool CanRobot::receive(const CanFrame& frame, std::int64_t arrival_us) {
  if (frame.length > 8) return false;
  const std::uint32_t node = frame.id >> 5, command = frame.id & 31u;
  bool taken = false;
  if (node == layout_.sensor_node) {
    taken = receive_board(command, frame);
  } else {
    for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
      if (layout_.motors[i].node == node)
        taken = receive_motor(motors_[i], layout_.motors[i].wheel_radius_m, command, frame);
  }
  if (taken && is_complete()) complete(arrival_us);
  return taken;
}

bool CanRobot::receive_motor(Motor& motor, double radius_m, std::uint32_t command, const CanFrame& frame) {
  switch (command) {
    case TILLER_ODRIVE_HEARTBEAT_FRAME_ID: return heartbeat(motor, frame);
    case TILLER_ODRIVE_GET_ENCODER_ESTIMATES_FRAME_ID: return encoder(motor, radius_m, frame);
    case TILLER_ODRIVE_GET_ERROR_FRAME_ID: {
      tiller_odrive_get_error_t message;
      if (tiller_odrive_get_error_unpack(&message, frame.data, frame.length) != 0) return false;
      motor.axis_error = message.active_errors;
      return true;
    }
    default: return false;
  }
}

// A driver that was asked to close its loop reports that with one of its next heartbeats. Until it does the
// request is repeated, because the frame may have been lost; once it did, leaving closed loop is the driver's
// own decision, i.e. a fault, and nothing is asked again.
bool CanRobot::heartbeat(Motor& motor, const CanFrame& frame) {
  tiller_odrive_heartbeat_t message;
  if (tiller_odrive_heartbeat_unpack(&message, frame.data, frame.length) != 0) return false;
  motor.beaten = true;
  motor.axis_error = message.axis_error;
  if (motor.wanted == 0) return true;
  if (message.axis_state == motor.wanted) {
    motor.confirmed = true;
    motor.waiting = 0;
  } else if (motor.confirmed && motor.wanted == TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_CLOSED_LOOP_CONTROL_CHOICE) {
    motor.disarmed = true;
  } else {
    motor.mode_due = true;
    ++motor.waiting;
  }
  return true;
}

bool CanRobot::encoder(Motor& motor, double radius_m, const CanFrame& frame) {
  tiller_odrive_get_encoder_estimates_t message;
  if (tiller_odrive_get_encoder_estimates_unpack(&message, frame.data, frame.length) != 0) return false;
  // generated code copies the bits of a float, whatever they are
  if (!std::isfinite(message.pos_estimate) || !std::isfinite(message.vel_estimate)) return false;
  motor.position = static_cast<double>(message.pos_estimate) * kTwoPi * radius_m;
  motor.velocity = static_cast<double>(message.vel_estimate) * kTwoPi * radius_m;
  motor.has_estimate = true;
  return true;
}

bool CanRobot::receive_board(std::uint32_t command, const CanFrame& frame) {
  if (command == TILLER_SENSORS_STAMP_FRAME_ID) {
    tiller_sensors_stamp_t message;
    if (tiller_sensors_stamp_unpack(&message, frame.data, frame.length) != 0) return false;
    begin(static_cast<std::uint16_t>(message.sequence));
    has_stamp_ = true;
    stamp_sequence_ = message.sequence;
    stamp_time_us_ = message.time_us;
    return true;
  }
  const std::uint32_t channel = command - TILLER_SENSORS_VALUE_FRAME_ID;  // wraps far above 11 for smaller ones
  if (channel >= kBoardChannels) return false;
  tiller_sensors_value_t message;
  if (tiller_sensors_value_unpack(&message, frame.data, frame.length) != 0) return false;
  begin(message.sequence_low);
  have_values_ |= 1u << channel;
  // a reading that the board marks invalid is missing, which the filter knows how to skip
  values_[channel] = message.valid != 0 ? message.reading * 1e-6 : std::numeric_limits<double>::quiet_NaN();
  return true;
}

// One node sends its frames in order, so a part of another sequence means that the rest of this one is lost.
void CanRobot::begin(std::uint16_t sequence_low) {
  if (assembling_ && sequence_low_ == sequence_low) return;
  if (assembling_ && (has_stamp_ || have_values_ != 0)) ++dropped_old_;
  assembling_ = true;
  sequence_low_ = sequence_low;
  has_stamp_ = false;
  have_values_ = 0;
}

bool CanRobot::is_complete() const {
  if (layout_.sensor_node != CanLayout::kNoBoard && !has_stamp_) return false;
  if ((have_values_ & needed_values_) != needed_values_) return false;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if ((needed_estimates_ >> i & 1u) != 0 && !motors_[i].has_estimate) return false;
  return true;
}

void CanRobot::complete(std::int64_t arrival_us) {
  const bool board = layout_.sensor_node != CanLayout::kNoBoard;
  tiller_measurement_t measurement{};
  measurement.sequence = board ? stamp_sequence_ : ++own_sequence_;
  measurement.stamp_us = board && !layout_.stamp_on_arrival ? unwrap(stamp_time_us_) : arrival_us;
  for (std::uint32_t i = 0; i < layout_.channel_count; ++i) measurement.value[i] = channel_value(layout_.channels[i]);
  has_stamp_ = false;
  have_values_ = 0;
  assembling_ = false;
  for (Motor& motor : motors_) motor.has_estimate = false;
  if (!gate_.accept(measurement.sequence, arrival_us)) {
    ++dropped_old_;
    return;
  }
  if (has_new_) ++dropped_old_;
  has_new_ = true;
  newest_ = measurement;
  watch_heartbeats(measurement.stamp_us);
}

// On the measurements' clock, so that simulated time that runs slowly does not raise it, nor a stopped
// program.
void CanRobot::watch_heartbeats(std::int64_t stamp_us) {
  silent_ = nullptr;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    Motor& motor = motors_[i];
    // the first measurement starts the time for a motor that has not been heard yet
    if (motor.beaten || !motor.watched || stamp_us < motor.heartbeat_us) motor.heartbeat_us = stamp_us;
    motor.watched = true;
    motor.beaten = false;
    if (layout_.heartbeat_timeout_us > 0 && stamp_us - motor.heartbeat_us > layout_.heartbeat_timeout_us)
      silent_ = "a motor's heartbeat is missing: check its power, node_id and heartbeat rate";
  }
}

std::int64_t CanRobot::unwrap(std::uint32_t time_us) {
  if (!has_time_) time_us_ = time_us;
  has_time_ = true;
  time_us_ += static_cast<std::int32_t>(time_us - static_cast<std::uint32_t>(time_us_));
  return time_us_;
}

double CanRobot::channel_value(const CanChannel& channel) const {
  switch (channel.source) {
    case CanSource::kMotorPosition: return motors_[channel.index].position;
    case CanSource::kMotorVelocity: return motors_[channel.index].velocity;
    case CanSource::kSensor: break;
  }
  return values_[channel.index];
}

bool CanRobot::take(tiller_measurement_t* measurement) {
  if (!has_new_) return false;
  has_new_ = false;
  *measurement = newest_;
  return true;
}

const char* CanRobot::fault_text() const {
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    const Motor& motor = motors_[i];
    if (motor.axis_error != 0) return "a motor reports an axis error";
    if (motor.disarmed) return "a motor has left closed loop on its own";
    if (motor.waiting > kArmHeartbeats && motor.wanted == TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_CLOSED_LOOP_CONTROL_CHOICE)
      return "a motor does not enter closed loop: calibrate it, clear its errors";
  }
  return silent_;
}

tiller_status_t CanRobot::fault() const {
  return fault_text() == nullptr ? tiller_status_ok : tiller_status_actuator_fault;
}

// ---- frames out ----

std::uint32_t CanRobot::command(const tiller_command_t& command, CanFrame* frames) {
  std::uint32_t count = 0;
  float torque_Nm[TILLER_MAX_INPUTS];
  bool is_zero = true;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    torque_Nm[i] = static_cast<float>(command.value[i] * layout_.motors[i].wheel_radius_m);
    if (!std::isfinite(torque_Nm[i])) return 0;
    is_zero = is_zero && torque_Nm[i] == 0.0f;
  }
  // a safe command other than zero (holding a weight) needs the loop closed
  const bool moves = command.state == tiller_state_active || command.state == tiller_state_hold || !is_zero;
  const std::uint32_t wanted = moves ? TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_CLOSED_LOOP_CONTROL_CHOICE
                                     : TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_IDLE_CHOICE;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    Motor& motor = motors_[i];
    if (motor.wanted != wanted) {
      motor.wanted = wanted;
      motor.mode_due = true;
      motor.confirmed = motor.disarmed = false;
      motor.waiting = 0;
    }
    if (motor.mode_due) count += request_mode(layout_.motors[i], motor, frames + count);
    CanFrame& frame = frames[count++];
    frame.id = can_id(layout_.motors[i].node, TILLER_ODRIVE_SET_INPUT_TORQUE_FRAME_ID);
    frame.length = TILLER_ODRIVE_SET_INPUT_TORQUE_LENGTH;
    tiller_odrive_set_input_torque_t message{torque_Nm[i]};
    tiller_odrive_set_input_torque_pack(frame.data, &message, sizeof frame.data);
  }
  if (layout_.sensor_node == CanLayout::kNoBoard) return count;
  CanFrame& frame = frames[count++];
  frame.id = can_id(layout_.sensor_node, TILLER_SENSORS_CONTROLLER_STATUS_FRAME_ID);
  frame.length = TILLER_SENSORS_CONTROLLER_STATUS_LENGTH;
  tiller_sensors_controller_status_t status{};
  status.answered_sequence = command.sequence;
  status.state = static_cast<std::uint8_t>(command.state);
  status.input_count = static_cast<std::uint8_t>(layout_.motor_count);
  status.plan_sequence_low = static_cast<std::uint8_t>(command.plan_sequence);
  tiller_sensors_controller_status_pack(frame.data, &status, sizeof frame.data);
  return count;
}

std::uint32_t CanRobot::request_mode(const CanMotor& config, Motor& motor, CanFrame* frames) {
  std::uint32_t count = 0;
  motor.mode_due = false;
  if (motor.wanted == TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_CLOSED_LOOP_CONTROL_CHOICE) {
    tiller_odrive_set_controller_mode_t mode{};
    mode.control_mode = TILLER_ODRIVE_SET_CONTROLLER_MODE_CONTROL_MODE_TORQUE_CHOICE;
    mode.input_mode = TILLER_ODRIVE_SET_CONTROLLER_MODE_INPUT_MODE_PASSTHROUGH_CHOICE;
    frames[count].id = can_id(config.node, TILLER_ODRIVE_SET_CONTROLLER_MODE_FRAME_ID);
    frames[count].length = TILLER_ODRIVE_SET_CONTROLLER_MODE_LENGTH;
    tiller_odrive_set_controller_mode_pack(frames[count].data, &mode, sizeof frames[count].data);
    ++count;
  }
  tiller_odrive_set_axis_state_t state{motor.wanted};
  frames[count].id = can_id(config.node, TILLER_ODRIVE_SET_AXIS_STATE_FRAME_ID);
  frames[count].length = TILLER_ODRIVE_SET_AXIS_STATE_LENGTH;
  tiller_odrive_set_axis_state_pack(frames[count].data, &state, sizeof frames[count].data);
  return count + 1;
}

std::uint32_t CanRobot::clear_faults(CanFrame* frames) {
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    Motor& motor = motors_[i];
    motor.axis_error = 0;
    motor.disarmed = motor.confirmed = false;
    motor.waiting = 0;
    motor.wanted = 0;  // asked again with the next command
    frames[i] = CanFrame();
    frames[i].id = can_id(layout_.motors[i].node, TILLER_ODRIVE_CLEAR_ERRORS_FRAME_ID);
    frames[i].length = TILLER_ODRIVE_CLEAR_ERRORS_LENGTH;
  }
  return layout_.motor_count;
}

}  // namespace tiller
