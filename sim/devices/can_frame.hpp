#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tiller::sim {

/// A CAN frame, classic or FD, apart from any socket: devices are tested without one.
struct CanFrame {
  std::uint32_t id = 0;
  std::uint8_t length = 0;
  bool remote = false;    ///< asks for data instead of carrying it
  bool extended = false;  ///< a 29-bit identifier
  bool fd = false;        ///< up to 64 bytes
  std::array<std::uint8_t, 64> data{};
};

using CanFrames = std::vector<CanFrame>;

/// CANSimple and the sensor board number their messages alike: node << 5 | command.
constexpr std::uint32_t can_id(std::uint32_t node, std::uint32_t command) { return node << 5 | command; }
constexpr std::uint32_t can_node(std::uint32_t id) { return id >> 5; }
constexpr std::uint32_t can_command(std::uint32_t id) { return id & 31u; }
constexpr std::uint32_t can_node_count = 64;

}  // namespace tiller::sim
