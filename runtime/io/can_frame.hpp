#pragma once

#include <cstdint>

namespace tiller {

/// A CAN data frame, classic or FD, apart from any socket.
struct CanFrame {
  std::uint32_t id = 0;     ///< 11 bits, or 29 where `extended`
  std::uint8_t length = 0;  ///< 0..8; FD: also 12, 16, 20, 24, 32, 48, 64
  bool extended = false;
  bool fd = false;
  std::uint8_t data[64] = {};
};

/// Lets a frame pass whose identifier equals `id` in the bits of `mask`.
struct CanFilter {
  std::uint32_t id = 0, mask = 0;
  bool extended = false;

  bool passes(const CanFrame& frame) const { return frame.extended == extended && ((frame.id ^ id) & mask) == 0; }
  bool overlaps(const CanFilter& other) const {
    return extended == other.extended && ((id ^ other.id) & mask & other.mask) == 0;
  }
};

constexpr std::uint32_t kStandardMask = 0x7ff, kExtendedMask = 0x1fffffff;

}  // namespace tiller
