// moteus: registers over CAN FD. Identifier: source << 8 | destination, the source's top bit asks for an answer; the
// host is 0. A drive speaks only when asked. Its watchdog latches: in mode "timeout" it takes no command until it was
// stopped; and stopping clears faults, so a drive that has one is only stopped by an operator's decision.
#include <cmath>
#include <limits>

#include "io/actuator.hpp"
#include "io/moteus_registers.hpp"

namespace tiller {
namespace {

using namespace moteus;

constexpr double kTwoPi = 6.283185307179586;
constexpr std::uint32_t kAnswer = 0x8000;  // of the source: please answer

enum Mode : int { kStopped = 0, kFaulted = 1, kFirstPowered = 5, kPositionMode = 10, kTimeout = 11 };

struct Fault {
  std::uint32_t code;
  const char* text;
};

constexpr Fault kFaults[] = {
    {32, "moteus: calibration fault: the encoder senses no magnet"},
    {33, "moteus: motor driver fault: check the supply's voltage"},
    {34, "moteus: the supply's voltage is too high (braking into a supply that takes none back?)"},
    {35, "moteus: encoder fault"},
    {36, "moteus: the motor is not configured: calibrate it"},
    {37, "moteus: PWM cycle overrun"},
    {38, "moteus: too hot"},
    {39, "moteus: outside of its position limits"},
    {40, "moteus: the supply's voltage is too low"},
    {41, "moteus: its configuration was changed while it ran"},
    {42, "moteus: no valid commutation encoder"},
    {43, "moteus: no valid output encoder"},
    {44, "moteus: the gate driver could not be enabled"},
    {45, "moteus: a stop position with limits"},
    {46, "moteus: an internal timing violation"},
    {47, "moteus: back-EMF feed-forward without an acceleration limit"},
    {48, "moteus: its position limits are not valid"},
};
constexpr std::uint32_t kTimeoutCode = 1000;  // not the drive's: it has a mode for it, and no code

const char* fault_text(std::uint32_t code) {
  for (const Fault& fault : kFaults)
    if (fault.code == code) return fault.text;
  if (code == kTimeoutCode) return "moteus: the watchdog has expired: commands came too late or not at all";
  return code != 0 ? "moteus: the drive reports a fault" : nullptr;
}

const char* settings_error(const ActuatorSettings& settings) {
  if (settings.node < 1 || settings.node > 126) return "a moteus has a node from 1 to 126";
  if (!(settings.watchdog_s >= 0.0 && settings.watchdog_s <= 10.0))
    return "a moteus' watchdog_s must be within 0 and 10 s";
  if (settings.resolution == MoteusResolution::int8 && settings.watchdog_s > 1.27)
    return "as int8 a moteus' watchdog_s is at most 1.27 s";
  return nullptr;
}

std::uint32_t filters(const ActuatorSettings& settings, CanFilter* out) {
  const std::uint32_t id = settings.node << 8;  // from the drive to 0
  out[0] = {id, kExtendedMask, true};
  if (id > kStandardMask) return 1;
  out[1] = {id, kStandardMask, false};
  return 2;
}

std::uint32_t command_filters(const ActuatorSettings& settings, CanFilter* out) {
  out[0] = {kAnswer | settings.node, kExtendedMask, true};
  return 1;
}

/// Reads one register. False: an impossible number.
bool take(std::uint32_t reg, const Reader& reader, ActuatorReport& report, int& mode) {
  double value = 0.0;
  switch (reg) {
    case kMode:
      value = reader.value(kCount);
      if (!(value >= 0.0 && value <= 100.0)) return false;
      mode = static_cast<int>(value);
      return true;
    case kPosition: report.position_rad = reader.value(kPositionStep) * kTwoPi; return true;
    case kVelocity: report.velocity_rad_s = reader.value(kVelocityStep) * kTwoPi; return true;
    case kTorque: report.torque_Nm = reader.value(kTorqueStep); return true;
    case kTemperature: report.temperature_C = reader.value(kTemperatureStep); return true;
    case kFault:
      value = reader.value(kCount);
      if (!(value >= 0.0 && value <= 255.0)) return false;
      report.fault = static_cast<std::uint32_t>(value);
      return true;
    default: return true;  // voltage, and what nobody asked for
  }
}

// Codes from 96 on tell what limits the drive while it works; only mode 1 makes a code a fault.
void judge(int mode, ActuatorReport& report) {
  report.has_mode = report.has_fault = true;
  report.enabled = mode >= kFirstPowered && mode != kTimeout;
  if (mode == kTimeout) report.fault = kTimeoutCode;
  if (mode == kFaulted && report.fault == 0) report.fault = 255;
  if (mode != kFaulted && mode != kTimeout) report.fault = 0;
  report.fault_text = fault_text(report.fault);
}

ActuatorReceipt receive(const ActuatorSettings& settings, const CanFrame& frame, ActuatorReport& report) {
  if ((frame.id & 0x7fffu) != settings.node << 8) return ActuatorReceipt::foreign;
  // bit 15 asks for an answer: a frame of another controller that goes by the drive's number
  if ((frame.id >> 15) != 0 || frame.length > sizeof frame.data) return ActuatorReceipt::refused;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  report.position_rad = report.velocity_rad_s = report.torque_Nm = report.temperature_C = nan;
  int mode = -1;
  Reader reader(frame);
  for (std::uint32_t reg; reader.next(reg);)
    if (!take(reg, reader, report, mode)) return ActuatorReceipt::refused;
  if (!reader.ok() || mode < 0) return ActuatorReceipt::refused;
  report.alive = true;
  report.has_motion = std::isfinite(report.position_rad) && std::isfinite(report.velocity_rad_s);
  report.has_torque = std::isfinite(report.torque_Nm);
  report.has_temperature = std::isfinite(report.temperature_C);
  judge(mode, report);
  return ActuatorReceipt::taken;
}

CanFrame frame_to(const ActuatorSettings& settings) {
  CanFrame frame;
  frame.id = kAnswer | settings.node;
  frame.extended = frame.fd = true;
  return frame;
}

/// Mode, position, velocity and torque in the settings' resolution; voltage, temperature and fault as int8.
void ask(Writer& writer, const ActuatorSettings& settings) {
  const bool one_size = settings.resolution == MoteusResolution::int8;
  writer.begin(kRead, MoteusResolution::int8, kMode, one_size ? 4 : 1);
  if (!one_size) writer.begin(kRead, settings.resolution, kPosition, 3);
  writer.begin(kRead, MoteusResolution::int8, kVoltage, 3);
}

void set_mode(Writer& writer, int mode) {
  writer.begin(kWrite, MoteusResolution::int8, kMode, 1);
  writer.value(mode, MoteusResolution::int8, kCount);
}

std::uint32_t enable(const ActuatorSettings&, CanFrame*) { return 0; }

std::uint32_t query(const ActuatorSettings& settings, CanFrame* out) {
  out[0] = frame_to(settings);
  Writer writer(out[0]);
  ask(writer, settings);
  writer.finish();
  return 1;
}

std::uint32_t stop(const ActuatorSettings& settings, CanFrame* out) {
  out[0] = frame_to(settings);
  Writer writer(out[0]);
  set_mode(writer, kStopped);
  ask(writer, settings);
  writer.finish();
  return 1;
}

/// Position mode, in which torque is feed-forward with all gains at zero, and velocity a position that is not given.
std::uint32_t command(const ActuatorSettings& settings, double value, CanFrame* out) {
  const ActuatorMode mode = settings.mode;
  const double gain = mode == ActuatorMode::torque ? 0.0 : 1.0;
  const MoteusResolution r = settings.resolution;
  out[0] = frame_to(settings);
  Writer writer(out[0]);
  set_mode(writer, kPositionMode);
  writer.begin(kWrite, r, kCommandPosition, 5);
  writer.value(mode == ActuatorMode::position ? value / kTwoPi : std::numeric_limits<double>::quiet_NaN(), r,
               kPositionStep);
  writer.value(mode == ActuatorMode::velocity ? value / kTwoPi : 0.0, r, kVelocityStep);
  writer.value(mode == ActuatorMode::torque ? value : 0.0, r, kTorqueStep);
  writer.value(gain, r, kScaleStep);  // kp
  writer.value(gain, r, kScaleStep);  // kd
  writer.begin(kWrite, r, kWatchdogTimeout, 1);
  writer.value(settings.watchdog_s, r, kTimeStep);
  writer.begin(kWrite, r, kIntegratorScale, 1);
  writer.value(gain, r, kScaleStep);
  ask(writer, settings);
  writer.finish();
  return 1;
}

constexpr std::uint32_t kCapabilities = kTellsEnabled | kTellsFaults | kTellsTorque | kTellsTemperature |
                                        kAnswersQueries | kNeedsFd | kStopClearsFaults |
                                        kProvesEnabled;  // every command carries the mode

std::uint32_t capabilities_of(const ActuatorSettings&) { return kCapabilities; }

}  // namespace

const ActuatorProtocol moteus_protocol = {kCapabilities,   settings_error, capabilities_of, filters,
                                          command_filters, receive,        enable,          stop,
                                          query,           command,        query,           stop};

}  // namespace tiller
