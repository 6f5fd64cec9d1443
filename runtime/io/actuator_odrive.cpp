// ODrive's CANSimple (firmware 0.6): 11-bit identifiers node << 5 | command, definitions in dbc/odrive.dbc, codecs by
// cantools. The drive sends heartbeats, estimates and whatever else it is configured to by itself.
#include <cmath>

#include "io/actuator.hpp"

extern "C" {
#include "tiller_odrive.h"
}

namespace tiller {
namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr std::uint32_t kNodes = 64;  // 6 bits of the identifier
constexpr std::uint32_t kClosedLoop = TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_CLOSED_LOOP_CONTROL_CHOICE;

struct Bit {
  std::uint32_t bit;
  const char* text;
};

/// The bits of ODrive.Error, the most telling first.
constexpr Bit kErrors[] = {
    {1u << 24, "odrive: the watchdog has expired: commands came too late or not at all"},
    {1u << 25, "odrive: an emergency stop was requested"},
    {1u << 8, "odrive: the bus voltage is too high (braking into a supply that takes none back?)"},
    {1u << 9, "odrive: the bus voltage is too low"},
    {1u << 10, "odrive: the bus current is too high"},
    {1u << 11, "odrive: too much current is fed back into the supply"},
    {1u << 12, "odrive: the motor's current limit was violated"},
    {1u << 13, "odrive: the motor is too hot"},
    {1u << 14, "odrive: the inverter is too hot"},
    {1u << 15, "odrive: the velocity limit was violated"},
    {1u << 16, "odrive: the position limit was violated"},
    {1u << 26, "odrive: the rotor spins out: check encoder and calibration"},
    {1u << 27, "odrive: the brake resistor is disarmed"},
    {1u << 28, "odrive: a thermistor is disconnected"},
    {1u << 30, "odrive: the calibration failed"},
    {1u << 3, "odrive: there is no position estimate: calibrate the encoder"},
    {1u << 4, "odrive: the configuration is not valid"},
    {1u << 5, "odrive: the gate driver reports a fault"},
    {1u << 6, "odrive: an input is missing"},
    {1u << 2, "odrive: a timing error in the drive"},
    {1u << 1, "odrive: a system error in the drive"},
    {1u << 0, "odrive: the drive is still starting"},
};

const char* error_text(std::uint32_t errors) {
  if (errors == 0) return nullptr;
  for (const Bit& error : kErrors)
    if ((errors & error.bit) != 0) return error.text;
  return "odrive: the axis reports an error";
}

CanFrame frame_of(const ActuatorSettings& settings, std::uint32_t command, std::uint8_t length) {
  CanFrame frame;
  frame.id = settings.node << 5 | command;
  frame.length = length;
  return frame;
}

const char* settings_error(const ActuatorSettings& settings) {
  return settings.node < kNodes ? nullptr : "an ODrive axis has a node from 0 to 63";
}

std::uint32_t filters(const ActuatorSettings& settings, CanFilter* out) {
  const std::uint32_t read[] = {TILLER_ODRIVE_HEARTBEAT_FRAME_ID, TILLER_ODRIVE_GET_ERROR_FRAME_ID,
                                TILLER_ODRIVE_GET_ENCODER_ESTIMATES_FRAME_ID, TILLER_ODRIVE_GET_TEMPERATURE_FRAME_ID,
                                TILLER_ODRIVE_GET_TORQUES_FRAME_ID};
  std::uint32_t count = 0;
  for (const std::uint32_t command : read) out[count++] = {settings.node << 5 | command, kStandardMask, false};
  return count;
}

std::uint32_t command_filters(const ActuatorSettings& settings, CanFilter* out) {
  const std::uint32_t commands[] = {TILLER_ODRIVE_SET_INPUT_TORQUE_FRAME_ID, TILLER_ODRIVE_SET_INPUT_VEL_FRAME_ID,
                                    TILLER_ODRIVE_SET_INPUT_POS_FRAME_ID};
  out[0] = {settings.node << 5 | commands[static_cast<std::size_t>(settings.mode)], kStandardMask, false};
  return 1;
}

bool heartbeat(const CanFrame& frame, ActuatorReport& report) {
  tiller_odrive_heartbeat_t in;
  if (tiller_odrive_heartbeat_unpack(&in, frame.data, frame.length) != 0) return false;
  report.alive = report.has_mode = report.has_fault = true;
  report.enabled = in.axis_state == kClosedLoop;
  report.fault = in.axis_error;
  return true;
}

bool errors(const CanFrame& frame, ActuatorReport& report) {
  tiller_odrive_get_error_t in;
  if (tiller_odrive_get_error_unpack(&in, frame.data, frame.length) != 0) return false;
  report.has_fault = true;
  report.fault = in.active_errors;
  return true;
}

// generated code copies the bits of a float, whatever they are
bool estimates(const CanFrame& frame, ActuatorReport& report) {
  tiller_odrive_get_encoder_estimates_t in;
  if (tiller_odrive_get_encoder_estimates_unpack(&in, frame.data, frame.length) != 0) return false;
  if (!std::isfinite(in.pos_estimate) || !std::isfinite(in.vel_estimate)) return false;
  report.has_motion = true;
  report.position_rad = static_cast<double>(in.pos_estimate) * kTwoPi;
  report.velocity_rad_s = static_cast<double>(in.vel_estimate) * kTwoPi;
  return true;
}

bool torques(const CanFrame& frame, ActuatorReport& report) {
  tiller_odrive_get_torques_t in;
  if (tiller_odrive_get_torques_unpack(&in, frame.data, frame.length) != 0) return false;
  if (!std::isfinite(in.torque_estimate)) return false;
  report.has_torque = true;
  report.torque_Nm = static_cast<double>(in.torque_estimate);
  return true;
}

// not a number: no thermistor there
bool temperatures(const CanFrame& frame, ActuatorReport& report) {
  tiller_odrive_get_temperature_t in;
  if (tiller_odrive_get_temperature_unpack(&in, frame.data, frame.length) != 0) return false;
  const double hottest = static_cast<double>(std::fmax(in.fet_temperature, in.motor_temperature));
  if (!std::isfinite(hottest)) return false;
  report.has_temperature = true;
  report.temperature_C = hottest;
  return true;
}

bool take(const CanFrame& frame, std::uint32_t command, ActuatorReport& report) {
  switch (command) {
    case TILLER_ODRIVE_HEARTBEAT_FRAME_ID: return heartbeat(frame, report);
    case TILLER_ODRIVE_GET_ERROR_FRAME_ID: return errors(frame, report);
    case TILLER_ODRIVE_GET_ENCODER_ESTIMATES_FRAME_ID: return estimates(frame, report);
    case TILLER_ODRIVE_GET_TORQUES_FRAME_ID: return torques(frame, report);
    case TILLER_ODRIVE_GET_TEMPERATURE_FRAME_ID: return temperatures(frame, report);
    default: return false;
  }
}

ActuatorReceipt receive(const ActuatorSettings& settings, const CanFrame& frame, ActuatorReport& report) {
  if (frame.extended || frame.id >> 5 != settings.node) return ActuatorReceipt::foreign;
  if (frame.fd || frame.length > 8 || !take(frame, frame.id & 31u, report)) return ActuatorReceipt::refused;
  report.fault_text = error_text(report.fault);
  return ActuatorReceipt::taken;
}

CanFrame axis_state(const ActuatorSettings& settings, std::uint32_t wanted) {
  CanFrame frame = frame_of(settings, TILLER_ODRIVE_SET_AXIS_STATE_FRAME_ID, TILLER_ODRIVE_SET_AXIS_STATE_LENGTH);
  const tiller_odrive_set_axis_state_t message{wanted};
  tiller_odrive_set_axis_state_pack(frame.data, &message, sizeof frame.data);
  return frame;
}

std::uint32_t enable(const ActuatorSettings& settings, CanFrame* out) {
  const std::uint32_t modes[] = {TILLER_ODRIVE_SET_CONTROLLER_MODE_CONTROL_MODE_TORQUE_CHOICE,
                                 TILLER_ODRIVE_SET_CONTROLLER_MODE_CONTROL_MODE_VELOCITY_CHOICE,
                                 TILLER_ODRIVE_SET_CONTROLLER_MODE_CONTROL_MODE_POSITION_CHOICE};
  tiller_odrive_set_controller_mode_t mode{};
  mode.control_mode = modes[static_cast<std::size_t>(settings.mode)];
  mode.input_mode = TILLER_ODRIVE_SET_CONTROLLER_MODE_INPUT_MODE_PASSTHROUGH_CHOICE;
  out[0] = frame_of(settings, TILLER_ODRIVE_SET_CONTROLLER_MODE_FRAME_ID, TILLER_ODRIVE_SET_CONTROLLER_MODE_LENGTH);
  tiller_odrive_set_controller_mode_pack(out[0].data, &mode, sizeof out[0].data);
  out[1] = axis_state(settings, kClosedLoop);
  return 2;
}

std::uint32_t disable(const ActuatorSettings& settings, CanFrame* out) {
  out[0] = axis_state(settings, TILLER_ODRIVE_HEARTBEAT_AXIS_STATE_IDLE_CHOICE);
  return 1;
}

CanFrame torque_frame(const ActuatorSettings& settings, float torque_Nm) {
  CanFrame frame = frame_of(settings, TILLER_ODRIVE_SET_INPUT_TORQUE_FRAME_ID, TILLER_ODRIVE_SET_INPUT_TORQUE_LENGTH);
  const tiller_odrive_set_input_torque_t message{torque_Nm};
  tiller_odrive_set_input_torque_pack(frame.data, &message, sizeof frame.data);
  return frame;
}

std::uint32_t idle(const ActuatorSettings& settings, CanFrame* out) {
  out[0] = torque_frame(settings, 0.0f);
  return 1;
}

std::uint32_t command(const ActuatorSettings& settings, double value, CanFrame* out) {
  if (settings.mode == ActuatorMode::torque) {
    out[0] = torque_frame(settings, static_cast<float>(value));
  } else if (settings.mode == ActuatorMode::velocity) {
    out[0] = frame_of(settings, TILLER_ODRIVE_SET_INPUT_VEL_FRAME_ID, TILLER_ODRIVE_SET_INPUT_VEL_LENGTH);
    const tiller_odrive_set_input_vel_t message{static_cast<float>(value / kTwoPi), 0.0f};
    tiller_odrive_set_input_vel_pack(out[0].data, &message, sizeof out[0].data);
  } else {
    out[0] = frame_of(settings, TILLER_ODRIVE_SET_INPUT_POS_FRAME_ID, TILLER_ODRIVE_SET_INPUT_POS_LENGTH);
    const tiller_odrive_set_input_pos_t message{static_cast<float>(value / kTwoPi), 0, 0};
    tiller_odrive_set_input_pos_pack(out[0].data, &message, sizeof out[0].data);
  }
  return 1;
}

std::uint32_t query(const ActuatorSettings&, CanFrame*) { return 0; }

std::uint32_t clear_faults(const ActuatorSettings& settings, CanFrame* out) {
  out[0] = frame_of(settings, TILLER_ODRIVE_CLEAR_ERRORS_FRAME_ID, TILLER_ODRIVE_CLEAR_ERRORS_LENGTH);
  return 1;
}

constexpr std::uint32_t kCapabilities =
    kTellsEnabled | kTellsFaults | kTellsTorque | kTellsTemperature | kSpeaksUnasked | kBoardNumbers;

std::uint32_t capabilities_of(const ActuatorSettings&) { return kCapabilities; }

}  // namespace

const ActuatorProtocol odrive_protocol = {kCapabilities, settings_error, capabilities_of, filters, command_filters,
                                          receive,       enable,         disable,         idle,    command,
                                          query,         clear_faults};

}  // namespace tiller
