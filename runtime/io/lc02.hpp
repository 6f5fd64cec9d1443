#pragma once

#include <cstdint>

namespace tiller {

/// LCM's packet of one datagram ("small message", LCM UDP Multicast Protocol Description):
///
///     "LC02" | sequence: uint32, big-endian | channel | 0 | message
///
/// Larger messages travel in fragments ("LC03"). Nothing that tiller exchanges needs them (clients begin to fragment
/// far above 1 kB), and putting them together would let a packet ask for memory: they are refused.
struct Lc02Packet {
  std::uint32_t sequence = 0;
  const char* channel = nullptr;  ///< inside the packet, with its 0
  const std::uint8_t* message = nullptr;
  std::uint32_t size = 0;  ///< of the message, may be 0
};

inline constexpr std::uint32_t kLc02HeaderBytes = 8;
inline constexpr std::uint32_t kLc02MaxChannel = 63;  ///< LCM_MAX_CHANNEL_NAME_LENGTH

/// Any bytes, any length. Null and a filled `packet`, or why not, as a literal.
const char* lc02_parse(const std::uint8_t* bytes, std::uint32_t size, Lc02Packet* packet);

/// Writes header and channel; the message follows at the returned offset. 0 if the channel's name is too long, empty,
/// or does not fit into `capacity`.
std::uint32_t lc02_begin(std::uint8_t* bytes, std::uint32_t capacity, std::uint32_t sequence, const char* channel);

}  // namespace tiller
