#include "sim/devices/mit_axis.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::sim {
namespace {

/// The firmware's own conversions: cut off, not rounded.
std::uint32_t to_code(double value, double limit, int bits) {
  const double span = 2 * limit;
  return static_cast<std::uint32_t>((std::clamp(value, -limit, limit) + limit) * ((1 << bits) - 1) / span);
}
double to_number(std::uint32_t code, double low, double high, int bits) {
  return code * (high - low) / ((1 << bits) - 1) + low;
}

}  // namespace

MitAxis::Event MitAxis::take(const CanFrame& frame, const Shaft& shaft, CanFrames& replies) {
  if (frame.id != options_.node || frame.extended) return Event::kNone;
  if (frame.remote || frame.fd || frame.length != 8) {
    ++ignored_frames_;
    return Event::kNone;
  }
  const auto& d = frame.data;
  Event event = Event::kNone;
  if (std::all_of(d.begin(), d.begin() + 7, [](std::uint8_t b) { return b == 0xff; }) && d[7] >= 0xfb) {
    event = special(d[7], shaft);
  } else if (entered_) {
    const double p = to_number(std::uint32_t(d[0]) << 8 | d[1], -options_.position_rad, options_.position_rad, 16);
    const double v =
        to_number(std::uint32_t(d[2]) << 4 | d[3] >> 4, -options_.velocity_rad_s, options_.velocity_rad_s, 12);
    const double kp = to_number((d[3] & 15u) << 8 | d[4], 0, options_.kp_Nm_rad, 12);
    const double kd = to_number(std::uint32_t(d[5]) << 4 | d[6] >> 4, 0, options_.kd_Nms_rad, 12);
    const double t = to_number((d[6] & 15u) << 8 | d[7], -options_.torque_Nm, options_.torque_Nm, 12);
    torque_Nm_ = t + kp * (p - (shaft.position_rad - zero_rad_)) + kd * (v - shaft.velocity_rad_s);
    event = Event::kTorque;
  }
  replies.push_back(answer(shaft));
  return event;
}

MitAxis::Event MitAxis::special(std::uint8_t code, const Shaft& shaft) {
  switch (code) {
    case 0xfb: error_ = 0; return Event::kNone;
    case 0xfc: entered_ = entered_ || error_ == 0; return Event::kNone;
    case 0xfd:
      entered_ = false;
      torque_Nm_ = 0;
      if (options_.reply != "damiao") error_ = 0;
      return Event::kDisarmed;
    case 0xfe: zero_rad_ = shaft.position_rad; return Event::kNone;
    default: ++ignored_frames_; return Event::kNone;
  }
}

void MitAxis::expire_watchdog() {
  torque_Nm_ = 0;
  if (options_.reply == "plain" || !entered_) return;
  fail(options_.reply == "damiao" ? kLostCommunication : 1);
}

CanFrame MitAxis::answer(const Shaft& shaft) const {
  const std::uint32_t p = to_code(shaft.position_rad - zero_rad_, options_.position_rad, 16);
  const std::uint32_t v = to_code(shaft.velocity_rad_s, options_.velocity_rad_s, 12);
  const std::uint32_t t = to_code(torque_Nm_, options_.torque_Nm, 12);
  CanFrame frame;
  frame.id = options_.reply_id;
  frame.length = options_.reply == "plain" ? 6 : 8;
  const int state = error_ != 0 ? error_ : entered_ ? 1 : 0;
  const auto byte = [](std::uint32_t value) { return static_cast<std::uint8_t>(value & 0xff); };
  frame.data[0] =
      byte(options_.reply == "damiao" ? options_.node | static_cast<std::uint32_t>(state) << 4 : options_.node);
  frame.data[1] = byte(p >> 8);
  frame.data[2] = byte(p);
  frame.data[3] = byte(v >> 4);
  frame.data[4] = byte((v & 15) << 4 | t >> 8);
  frame.data[5] = byte(t);
  if (options_.reply == "plain") return frame;
  frame.data[6] = 25;  // degrees
  frame.data[7] = options_.reply == "damiao" ? 30 : byte(static_cast<std::uint32_t>(error_));
  return frame;
}

std::unique_ptr<DriveAxis> make_mit_axis(const DriveOptions& options);
std::unique_ptr<DriveAxis> make_mit_axis(const DriveOptions& options) { return std::make_unique<MitAxis>(options); }

}  // namespace tiller::sim
