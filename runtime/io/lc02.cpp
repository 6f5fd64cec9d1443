#include "io/lc02.hpp"

#include <cstring>

#include "io/big_endian.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kWhole = 0x4c433032;     // "LC02"
constexpr std::uint32_t kFragment = 0x4c433033;  // "LC03"

}  // namespace

const char* lc02_parse(const std::uint8_t* bytes, std::uint32_t size, Lc02Packet* packet) {
  if (size < kLc02HeaderBytes) return "a packet is too short for LCM";
  const std::uint32_t magic = load_u32(bytes);
  if (magic == kFragment) return "a packet is a fragment of a larger message";
  if (magic != kWhole) return "a packet is not LCM's";
  const std::uint8_t* channel = bytes + kLc02HeaderBytes;
  const std::uint32_t rest = size - kLc02HeaderBytes;
  const std::uint32_t reach = rest < kLc02MaxChannel + 1 ? rest : kLc02MaxChannel + 1;
  const void* end = reach > 0 ? std::memchr(channel, 0, reach) : nullptr;
  if (end == nullptr) return "a packet's channel does not end";
  const auto length = static_cast<std::uint32_t>(static_cast<const std::uint8_t*>(end) - channel);
  packet->sequence = load_u32(bytes + 4);
  packet->channel = reinterpret_cast<const char*>(channel);
  packet->message = channel + length + 1;
  packet->size = rest - length - 1;
  return nullptr;
}

std::uint32_t lc02_begin(std::uint8_t* bytes, std::uint32_t capacity, std::uint32_t sequence, const char* channel) {
  const std::size_t length = std::strlen(channel);
  if (length == 0 || length > kLc02MaxChannel || kLc02HeaderBytes + length + 1 > capacity) return 0;
  store_u32(bytes, kWhole);
  store_u32(bytes + 4, sequence);
  std::memcpy(bytes + kLc02HeaderBytes, channel, length + 1);
  return static_cast<std::uint32_t>(kLc02HeaderBytes + length + 1);
}

}  // namespace tiller
