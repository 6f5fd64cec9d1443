#pragma once

#include <cstring>

#include "fuzz.hpp"
#include "io/can_robot.hpp"

namespace fuzz {

/// Identifiers of all kinds: node and command, what a moteus or a MIT drive answers with, anything.
inline tiller::CanFrame can_frame(Bytes& input) {
  static constexpr std::uint32_t kNodes[] = {1, 2, 48, 63};
  tiller::CanFrame frame;
  const std::uint8_t kind = input.byte(), choice = input.byte();
  frame.id = kNodes[choice >> 5 & 3] << 5 | (choice & 31u);
  if (kind % 4 == 1) frame.id = static_cast<std::uint32_t>(choice) << 8;
  if (kind % 4 == 2) frame.id = choice;
  if (kind % 4 == 3) frame.id = input.word();
  frame.fd = (kind & 4) != 0;
  frame.extended = (kind & 8) != 0;
  frame.length = input.byte();
  const std::string bytes = input.take(frame.length < sizeof frame.data ? frame.length : sizeof frame.data);
  std::memcpy(frame.data, bytes.data(), bytes.size());
  return frame;
}

inline void check_frames(const tiller::CanRobot& robot, const tiller::CanFrame* frames, std::uint32_t count) {
  require(count <= tiller::CanRobot::kMaxFrames, "frames fit their places");
  for (std::uint32_t i = 0; i < count; ++i) {
    require(frames[i].length <= (frames[i].fd ? 64 : 8), "a frame has a possible length");
    require(!frames[i].fd || robot.needs_fd(), "a bus without FD gets classic frames");
  }
}

}  // namespace fuzz
