#pragma once

#include <cstdint>

#include "io/can_frame.hpp"

namespace tiller {

/// What the frames of sensors.dbc have room for.
constexpr std::uint32_t kBoardChannels = 12, kBoardMotors = 15;

/// The frames of a sensor board (dbc/sensors.dbc), as numbers. Two layouts share the bus: version 0 without protection,
/// and version 1, in which the last byte is a CRC-8 over identifier and content (core/e2e.hpp; Hamming distance 4 at
/// this length) and the measurement's own number is the counter.
///
/// A reader takes version 0 until it has seen version 1: from then on what is not protected is refused, so that a
/// damaged version cannot pass for an old layout.
struct BoardFrame {
  enum class Kind : std::uint8_t { refused, stamp, value };

  Kind kind = Kind::refused;
  std::uint32_t time_us = 0;        ///< stamp: low 32 bits of the board's clock
  std::uint32_t sequence = 0;       ///< low bits of the measurement's number
  std::uint32_t sequence_bits = 0;  ///< how many of them: 32, 24 or 16
  std::uint32_t channel = 0;        ///< value: 0..11
  double value = 0.0;               ///< NaN where the board marks it invalid
};

class BoardReader {
 public:
  /// `frame` is of the board's node. Any bytes.
  BoardFrame read(const CanFrame& frame);
  bool is_protected() const { return protected_; }

 private:
  bool admit(const CanFrame& frame, std::uint32_t version);
  bool protected_ = false;
};

/// CRC of a frame of 8 bytes: over its identifier and the first seven.
std::uint8_t board_crc(const CanFrame& frame);

}  // namespace tiller
