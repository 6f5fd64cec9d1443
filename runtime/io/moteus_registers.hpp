#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "io/actuator.hpp"

namespace tiller::moteus {

// Registers and their steps, and the subframes that carry them: moteus' protocol reference ("CAN protocol", "Register
// reference"). All integers are least significant byte first.

enum Register : std::uint32_t {
  kMode = 0x000,
  kPosition = 0x001,
  kVelocity = 0x002,
  kTorque = 0x003,
  kVoltage = 0x00d,
  kTemperature = 0x00e,
  kFault = 0x00f,
  kCommandPosition = 0x020,
  kWatchdogTimeout = 0x027,
  kIntegratorScale = 0x02b,
};

enum Subframe : std::uint8_t {
  kWrite = 0x00,
  kRead = 0x10,
  kReply = 0x20,
  kWriteError = 0x30,
  kReadError = 0x31,
  kNop = 0x50
};

/// One unit of int8, int16 and int32, by quantity.
struct Step {
  double int8, int16, int32;
};
constexpr Step kCount = {1, 1, 1};
constexpr Step kPositionStep = {0.01, 0.0001, 0.00001};  // revolutions
constexpr Step kVelocityStep = {0.1, 0.00025, 0.00001};  // revolutions/s
constexpr Step kTorqueStep = {0.5, 0.01, 0.001};         // Nm
constexpr Step kTimeStep = {0.01, 0.001, 0.000001};      // s
constexpr Step kTemperatureStep = {1, 0.1, 0.001};       // degC
constexpr Step kScaleStep = {1.0 / 127, 1.0 / 32767, 1.0 / 2147483647};

constexpr std::uint32_t size_of(MoteusResolution r) {
  return r == MoteusResolution::int8 ? 1 : r == MoteusResolution::int16 ? 2 : 4;
}

/// Appends subframes to a frame of at most 64 bytes. The caller keeps within them (the longest command takes 44).
class Writer {
 public:
  explicit Writer(CanFrame& frame) : frame_(frame) {}

  /// Begins a subframe of `count` registers from `first`; up to three are counted in its first byte.
  void begin(Subframe kind, MoteusResolution resolution, std::uint32_t first, std::uint32_t count) {
    const std::uint32_t type = static_cast<std::uint32_t>(kind) | static_cast<std::uint32_t>(resolution) << 2;
    byte(type | (count <= 3 ? count : 0));
    if (count > 3) byte(count);
    byte(first);  // below 128: one byte of a varuint
  }

  /// Towards zero, never further than asked; beyond the range its end. NaN is the most negative integer.
  void value(double value, MoteusResolution resolution, const Step& step) {
    switch (resolution) {
      case MoteusResolution::int8: integer(value / step.int8, 127, 1); break;
      case MoteusResolution::int16: integer(value / step.int16, 32767, 2); break;
      case MoteusResolution::int32: integer(value / step.int32, 2147483647, 4); break;
      case MoteusResolution::f32: {
        const float single = static_cast<float>(value);
        std::uint32_t bits;
        std::memcpy(&bits, &single, sizeof bits);
        little_endian(bits, 4);
        break;
      }
    }
  }

  /// Fills up to a length that FD frames have.
  void finish() {
    constexpr std::uint8_t lengths[] = {12, 16, 20, 24, 32, 48, 64};
    std::uint8_t whole = frame_.length;
    if (whole > 8) {
      for (const std::uint8_t length : lengths) {
        whole = length;
        if (length >= frame_.length) break;
      }
    }
    while (frame_.length < whole) byte(kNop);
  }

 private:
  void byte(std::uint32_t value) {
    if (frame_.length < sizeof frame_.data) frame_.data[frame_.length++] = static_cast<std::uint8_t>(value);
  }
  void little_endian(std::uint32_t bits, int bytes) {
    for (int i = 0; i < bytes; ++i) byte(bits >> (8 * i));
  }
  void integer(double scaled, double most, int bytes) {
    double whole = -most - 1.0;
    if (!std::isnan(scaled)) whole = std::trunc(std::fmin(std::fmax(scaled, -most), most));
    little_endian(static_cast<std::uint32_t>(static_cast<std::int32_t>(whole)), bytes);
  }

  CanFrame& frame_;
};

/// Walks the values of the reply subframes of a frame, whatever its bytes are.
class Reader {
 public:
  explicit Reader(const CanFrame& frame) : frame_(frame) {}

  /// The next register with its raw value. False: there is none, or the frame is broken (ok() tells).
  bool next(std::uint32_t& reg) {
    while (left_ == 0) {
      if (at_ >= frame_.length || !subframe()) return false;
    }
    if (!has(size_of(resolution_))) return fail();
    value_at_ = at_;
    at_ += size_of(resolution_);
    reg = register_++;
    --left_;
    return true;
  }

  /// The value of the register just read. NaN where the drive says so, and at the ends of an integer's range, where
  /// the true value may lie beyond.
  double value(const Step& step) const {
    std::uint32_t bits = 0;
    for (std::uint32_t i = 0; i < size_of(resolution_); ++i)
      bits |= static_cast<std::uint32_t>(frame_.data[value_at_ + i]) << (8 * i);
    switch (resolution_) {
      case MoteusResolution::int8: return scaled(static_cast<std::int8_t>(bits), 127, step.int8);
      case MoteusResolution::int16: return scaled(static_cast<std::int16_t>(bits), 32767, step.int16);
      case MoteusResolution::int32: return scaled(static_cast<std::int32_t>(bits), 2147483647, step.int32);
      case MoteusResolution::f32: break;
    }
    float single;
    std::memcpy(&single, &bits, sizeof single);
    return static_cast<double>(single);
  }

  bool ok() const { return ok_; }

 private:
  bool fail() {
    ok_ = false;
    return false;
  }
  bool has(std::uint32_t bytes) const { return frame_.length - at_ >= bytes; }

  static double scaled(std::int32_t whole, std::int32_t most, double step) {
    if (whole >= most || whole <= -most) return std::numeric_limits<double>::quiet_NaN();
    return whole * step;
  }

  bool varuint(std::uint32_t& value) {
    value = 0;
    for (int shift = 0; shift < 35; shift += 7) {
      if (!has(1)) return fail();
      const std::uint32_t byte = frame_.data[at_++];
      value |= (byte & 0x7fu) << shift;
      if ((byte & 0x80u) == 0) return true;
    }
    return fail();
  }

  bool subframe() {
    const std::uint8_t kind = frame_.data[at_++];
    if (kind == kNop) return true;
    if (kind == kWriteError || kind == kReadError) {
      std::uint32_t ignored;
      return varuint(ignored) && varuint(ignored);
    }
    if ((kind & 0xf0u) != kReply) return fail();
    resolution_ = static_cast<MoteusResolution>(kind >> 2 & 3u);
    left_ = kind & 3u;
    if (left_ == 0 && !varuint(left_)) return false;
    return varuint(register_);
  }

  const CanFrame& frame_;
  std::uint32_t at_ = 0, value_at_ = 0;
  std::uint32_t left_ = 0, register_ = 0;
  MoteusResolution resolution_ = MoteusResolution::int8;
  bool ok_ = true;
};

}  // namespace tiller::moteus
