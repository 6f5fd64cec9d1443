// The MIT mini-cheetah protocol: eight bytes of packed numbers to the motor's identifier, an answer for every frame
// under one identifier for all. Layout: B. Katz, "A low cost modular actuator for dynamic robots", MIT 2018, and his
// controller's CAN_com; dialects: the manuals of CubeMars AK and Damiao DM drives. The high byte comes first.
#include <cmath>

#include "io/actuator.hpp"

namespace tiller {
namespace {

enum Special : std::uint8_t { kClear = 0xfb, kEnter = 0xfc, kExit = 0xfd, kZero = 0xfe };

struct Fault {
  std::uint32_t code;
  const char* text;
};

constexpr Fault kDamiaoFaults[] = {
    {0x8, "mit: over-voltage"},
    {0x9, "mit: under-voltage"},
    {0xa, "mit: over-current"},
    {0xb, "mit: the MOSFETs are too hot"},
    {0xc, "mit: the motor's coil is too hot"},
    {0xd, "mit: the watchdog has expired: commands came too late or not at all"},
    {0xe, "mit: overload"},
};

const char* damiao_text(std::uint32_t code) {
  for (const Fault& fault : kDamiaoFaults)
    if (fault.code == code) return fault.text;
  return code != 0 ? "mit: the drive reports an error" : nullptr;
}

bool is_positive(double value) { return std::isfinite(value) && value > 0.0; }

const char* settings_error(const ActuatorSettings& settings) {
  const MitRange& range = settings.range;
  const std::uint32_t last = settings.reply == MitReply::damiao ? 15 : 127;
  if (settings.node < 1 || settings.node > last)
    return "a motor of the MIT protocol has a node from 1 to 127 (Damiao: 15)";
  if (settings.reply_id > kStandardMask) return "the reply_id of the MIT protocol has 11 bits";
  if (!is_positive(range.position_rad) || !is_positive(range.velocity_rad_s) || !is_positive(range.torque_Nm) ||
      !is_positive(range.kp_Nm_rad) || !is_positive(range.kd_Nms_rad))
    return "the ranges of the MIT protocol must be positive";
  if (!(settings.kp_Nm_rad >= 0.0 && settings.kp_Nm_rad <= range.kp_Nm_rad) ||
      !(settings.kd_Nms_rad >= 0.0 && settings.kd_Nms_rad <= range.kd_Nms_rad))
    return "a gain of the MIT protocol is outside of its range";
  if (settings.mode == ActuatorMode::position && settings.kp_Nm_rad == 0.0)
    return "position commands of the MIT protocol need a gain kp";
  if (settings.mode == ActuatorMode::velocity && settings.kd_Nms_rad == 0.0)
    return "velocity commands of the MIT protocol need a gain kd";
  return nullptr;
}

/// The nearest of the 2^bits numbers between low and high, the lower of two. (The firmware's own conversion cuts
/// off: twice the error, all to one side. Both make 0x7ff of a zero torque.)
std::uint32_t pack(double value, double low, double high, int bits) {
  const double top = static_cast<double>((1 << bits) - 1);
  const double at = (std::fmin(std::fmax(value, low), high) - low) * top / (high - low);
  return static_cast<std::uint32_t>(std::fmax(std::ceil(at - 0.5), 0.0));
}

double unpack(std::uint32_t code, double limit, int bits) {
  const double top = static_cast<double>((1 << bits) - 1);
  return code * (2.0 * limit) / top - limit;
}

std::uint32_t capabilities_of(const ActuatorSettings& settings) {
  std::uint32_t all = kTellsTorque | kNodeInside | kEndsAtRange;
  if (settings.reply != MitReply::plain) all |= kTellsFaults | kTellsTemperature;
  if (settings.reply == MitReply::damiao) all |= kTellsEnabled | kProvesEnabled;
  return all;
}

std::uint32_t filters(const ActuatorSettings& settings, CanFilter* out) {
  out[0] = {settings.reply_id, kStandardMask, false};
  return 1;
}

std::uint32_t command_filters(const ActuatorSettings& settings, CanFilter* out) {
  out[0] = {settings.node, kStandardMask, false};
  return settings.node != settings.reply_id ? 1 : 0;
}

// CubeMars: one temperature, printed without an offset in the MIT mode; 0 is none. Damiao: MOSFETs and coil.
void extras(const ActuatorSettings& settings, const CanFrame& frame, ActuatorReport& report) {
  if (settings.reply == MitReply::ak) {
    report.has_fault = report.has_temperature = true;
    report.temperature_C = static_cast<std::int8_t>(frame.data[6]);
    report.fault = frame.data[7];
    // the numbers mean different things from one edition of the manual to the next
    report.fault_text = report.fault != 0 ? "mit: the drive reports an error; its manual explains the code" : nullptr;
  } else if (settings.reply == MitReply::damiao) {
    const std::uint32_t state = frame.data[0] >> 4;  // 0 disabled, 1 enabled, else an error
    report.has_mode = report.has_fault = report.has_temperature = true;
    report.enabled = state == 1;
    report.fault = state >= 2 ? state : 0;
    report.fault_text = damiao_text(report.fault);
    report.temperature_C = static_cast<double>(frame.data[6] > frame.data[7] ? frame.data[6] : frame.data[7]);
  }
}

ActuatorReceipt receive(const ActuatorSettings& settings, const CanFrame& frame, ActuatorReport& report) {
  if (frame.extended || frame.id != settings.reply_id || frame.length == 0) return ActuatorReceipt::foreign;
  const std::uint32_t mask = settings.reply == MitReply::damiao ? 0x0fu : 0xffu;
  if ((frame.data[0] & mask) != settings.node) return ActuatorReceipt::foreign;
  // drives of the first kind may send two bytes more, which say nothing
  const bool length_ok = settings.reply == MitReply::plain ? frame.length >= 6 && frame.length <= 8 : frame.length == 8;
  if (frame.fd || !length_ok) return ActuatorReceipt::refused;
  const std::uint8_t* d = frame.data;
  report.alive = report.has_motion = report.has_torque = true;
  report.position_rad = unpack(static_cast<std::uint32_t>(d[1]) << 8 | d[2], settings.range.position_rad, 16);
  report.velocity_rad_s = unpack(static_cast<std::uint32_t>(d[3]) << 4 | d[4] >> 4, settings.range.velocity_rad_s, 12);
  report.torque_Nm = unpack((d[4] & 0x0fu) << 8 | d[5], settings.range.torque_Nm, 12);
  extras(settings, frame, report);
  return ActuatorReceipt::taken;
}

std::uint32_t special(const ActuatorSettings& settings, Special code, CanFrame* out) {
  out[0] = CanFrame();
  out[0].id = settings.node;
  out[0].length = 8;
  for (int i = 0; i < 7; ++i) out[0].data[i] = 0xff;
  out[0].data[7] = code;
  return 1;
}

std::uint32_t enable(const ActuatorSettings& settings, CanFrame* out) { return special(settings, kEnter, out); }

std::uint32_t disable(const ActuatorSettings& settings, CanFrame* out) { return special(settings, kExit, out); }

std::uint32_t command(const ActuatorSettings& settings, double value, CanFrame* out) {
  const MitRange& range = settings.range;
  const ActuatorMode mode = settings.mode;
  const double kp = mode == ActuatorMode::position ? settings.kp_Nm_rad : 0.0;
  const double kd = mode == ActuatorMode::torque ? 0.0 : settings.kd_Nms_rad;
  const std::uint32_t p =
      pack(mode == ActuatorMode::position ? value : 0.0, -range.position_rad, range.position_rad, 16);
  const std::uint32_t v =
      pack(mode == ActuatorMode::velocity ? value : 0.0, -range.velocity_rad_s, range.velocity_rad_s, 12);
  const std::uint32_t t = pack(mode == ActuatorMode::torque ? value : 0.0, -range.torque_Nm, range.torque_Nm, 12);
  const std::uint32_t gains[] = {pack(kp, 0.0, range.kp_Nm_rad, 12), pack(kd, 0.0, range.kd_Nms_rad, 12)};
  out[0] = CanFrame();
  out[0].id = settings.node;
  out[0].length = 8;
  const std::uint32_t high = p << 16 | v << 4 | gains[0] >> 8;
  const std::uint32_t low = gains[0] << 24 | gains[1] << 12 | t;
  for (int i = 0; i < 4; ++i) {
    out[0].data[i] = static_cast<std::uint8_t>(high >> (24 - 8 * i));
    out[0].data[4 + i] = static_cast<std::uint8_t>(low >> (24 - 8 * i));
  }
  return 1;  // never a special frame: at least one gain is 0, or position or velocity stands in the middle
}

std::uint32_t query(const ActuatorSettings&, CanFrame*) { return 0; }

// The first controller has no such frame: leaving the motor mode is what resets it.
std::uint32_t clear_faults(const ActuatorSettings& settings, CanFrame* out) {
  return special(settings, settings.reply == MitReply::damiao ? kClear : kExit, out);
}

}  // namespace

const ActuatorProtocol mit_protocol = {
    kTellsTorque | kTellsFaults | kTellsTemperature | kTellsEnabled | kProvesEnabled | kNodeInside | kEndsAtRange,
    settings_error,
    capabilities_of,
    filters,
    command_filters,
    receive,
    enable,
    disable,
    disable,
    command,
    query,
    clear_faults};

}  // namespace tiller
