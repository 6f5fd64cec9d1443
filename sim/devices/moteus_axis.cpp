#include "sim/devices/moteus_axis.hpp"

#include <cmath>
#include <cstring>
#include <limits>

namespace tiller::sim {
namespace {

constexpr double turn = 6.283185307179586;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr int type_int8 = 0, type_int16 = 1, type_int32 = 2, type_f32 = 3;

/// The step of a register's integers; {int8, int16, int32}.
double step_of(std::uint32_t reg, int type) {
  static const double position[] = {0.01, 1e-4, 1e-5}, velocity[] = {0.1, 0.00025, 1e-5}, torque[] = {0.5, 0.01, 1e-3},
                      scale[] = {1.0 / 127, 1.0 / 32767, 1.0 / 2147483647}, time[] = {0.01, 1e-3, 1e-6},
                      tenth[] = {0.5, 0.1, 1e-3}, celsius[] = {1, 0.1, 1e-3};
  switch (reg) {
    case 0x001:
    case 0x020: return position[type];
    case 0x002:
    case 0x021: return velocity[type];
    case 0x003:
    case 0x022:
    case 0x025: return torque[type];
    case 0x023:
    case 0x024:
    case 0x02b: return scale[type];
    case 0x027: return time[type];
    case 0x00d: return tenth[type];
    case 0x00e: return celsius[type];
    default: return 1;
  }
}

int size_of(int type) { return type == type_int8 ? 1 : type == type_int16 ? 2 : 4; }

/// Bytes of a frame, read once from front to back; `good` turns false beyond the end.
struct Cursor {
  const CanFrame& frame;
  std::size_t at = 0;
  bool good = true;

  bool more() const { return good && at < frame.length; }
  std::uint8_t byte() {
    if (at >= frame.length) good = false;
    return good ? frame.data[at++] : 0;
  }
  std::uint32_t varuint() {
    std::uint32_t value = 0;
    for (int shift = 0; shift <= 28; shift += 7) {
      const std::uint8_t b = byte();
      value |= std::uint32_t(b & 0x7f) << shift;
      if (b < 0x80) return value;
    }
    good = false;
    return 0;
  }
  double value(std::uint32_t reg, int type) {
    std::uint32_t raw = 0;
    for (int i = 0; i < size_of(type); ++i) raw |= std::uint32_t(byte()) << (8 * i);
    if (type == type_f32) {
      float f;
      std::memcpy(&f, &raw, 4);
      return f;
    }
    const int unused = 32 - 8 * size_of(type);
    const auto whole = static_cast<std::int32_t>(raw << unused) >> unused;
    const bool lowest = whole == std::numeric_limits<std::int32_t>::min() >> unused;
    return lowest ? nan : whole * step_of(reg, type);
  }
};

struct Read {
  std::uint32_t first, count;
  int type;
};

void append_value(CanFrame& frame, double value, std::uint32_t reg, int type) {
  std::uint32_t raw = 0;
  if (type == type_f32) {
    const auto f = static_cast<float>(value);
    std::memcpy(&raw, &f, 4);
  } else {
    const double most = std::ldexp(1.0, 8 * size_of(type) - 1) - 1;
    const double whole =
        std::isnan(value) ? -most - 1 : std::trunc(std::fmin(std::fmax(value / step_of(reg, type), -most), most));
    raw = static_cast<std::uint32_t>(static_cast<std::int64_t>(whole));
  }
  for (int i = 0; i < size_of(type); ++i) frame.data[frame.length++] = static_cast<std::uint8_t>(raw >> (8 * i));
}

void pad(CanFrame& frame) {
  for (const int length : {8, 12, 16, 20, 24, 32, 48, 64}) {
    if (frame.length <= length) {
      while (frame.length > 8 && frame.length < length) frame.data[frame.length++] = 0x50;
      return;
    }
  }
}

/// What one frame asks for: values written in their order, and what to read.
struct Request {
  std::map<std::uint32_t, double> written;
  std::vector<Read> reads;
};

bool parse(const CanFrame& frame, Request& request) {
  Cursor in{frame};
  while (in.more()) {
    const std::uint8_t kind = in.byte();
    if (kind == 0x50) continue;
    if (kind >= 0x20) return false;
    const int type = kind >> 2 & 3;
    const std::uint32_t count = (kind & 3) != 0 ? kind & 3 : in.varuint();
    const std::uint32_t first = in.varuint();
    if (count > 64) return false;
    if (kind >= 0x10) {
      request.reads.push_back({first, count, type});
      continue;
    }
    for (std::uint32_t i = 0; i < count; ++i) request.written[first + i] = in.value(first + i, type);
  }
  return in.good;
}

}  // namespace

MoteusAxis::Event MoteusAxis::take(const CanFrame& frame, const Shaft& shaft, CanFrames& replies) {
  if (frame.remote || (frame.id & 0x7f) != node_) return Event::kNone;
  Request request;
  if (!frame.fd || !parse(frame, request)) {
    ++ignored_frames_;
    return Event::kNone;
  }
  const Event event = request.written.empty() ? Event::kNone : act(request.written, shaft);
  if ((frame.id & 0x8000) == 0 || request.reads.empty()) return event;
  CanFrame reply;
  const std::uint32_t host = frame.id >> 8 & 0x7f;
  reply.id = node_ << 8 | host;
  reply.extended = reply.id > 0x7ff;
  reply.fd = true;
  for (const Read& read : request.reads) {
    reply.data[reply.length++] = static_cast<std::uint8_t>(0x20 | read.type << 2 | (read.count <= 3 ? read.count : 0));
    if (read.count > 3) reply.data[reply.length++] = static_cast<std::uint8_t>(read.count);
    reply.data[reply.length++] = static_cast<std::uint8_t>(read.first);
    for (std::uint32_t i = 0; i < read.count && reply.length < 60; ++i)
      append_value(reply, register_value(read.first + i, shaft), read.first + i, read.type);
  }
  pad(reply);
  replies.push_back(reply);
  return event;
}

MoteusAxis::Event MoteusAxis::write_mode(int mode) {
  if (mode == kStopped) {
    stop(kStopped);
    fault_ = 0;
    return Event::kDisarmed;
  }
  if (mode != kPosition || mode_ == kFault || mode_ == kTimeout) {
    ++ignored_frames_;
    return Event::kNone;
  }
  mode_ = kPosition;
  return Event::kTorque;
}

MoteusAxis::Event MoteusAxis::act(const std::map<std::uint32_t, double>& written, const Shaft& shaft) {
  const auto get = [&](std::uint32_t reg, double otherwise) {
    const auto found = written.find(reg);
    return found == written.end() || std::isnan(found->second) ? otherwise : found->second;
  };
  const auto mode = written.find(0x000);
  if (mode == written.end() || std::isnan(mode->second)) return Event::kNone;  // a command begins with its mode
  const Event event = write_mode(static_cast<int>(mode->second));
  if (event != Event::kTorque) return event;
  const double position_rev = shaft.position_rad / turn, velocity_rev_s = shaft.velocity_rad_s / turn;
  const double wanted_rev = written.count(0x020) != 0 ? get(0x020, position_rev) : 0;
  torque_Nm_ = get(0x022, 0) + get(0x023, 1) * kKp_Nm_rev * (wanted_rev - position_rev) +
               get(0x024, 1) * kKd_Nms_rev * (get(0x021, 0) - velocity_rev_s);
  return Event::kTorque;
}

double MoteusAxis::register_value(std::uint32_t reg, const Shaft& shaft) const {
  switch (reg) {
    case 0x000: return mode_;
    case 0x001: return shaft.position_rad / turn;
    case 0x002: return shaft.velocity_rad_s / turn;
    case 0x003: return torque_Nm_;
    case 0x00d: return 24;
    case 0x00e: return 25;
    case 0x00f: return fault_;
    default: return 0;
  }
}

std::unique_ptr<DriveAxis> make_moteus_axis(const DriveOptions& options);
std::unique_ptr<DriveAxis> make_moteus_axis(const DriveOptions& options) {
  return std::make_unique<MoteusAxis>(options.node);
}

}  // namespace tiller::sim
