#pragma once

#include <cstdint>

namespace tiller {

/// Network byte order, a byte at a time: no alignment, no aliasing, the same on every machine.
inline std::uint32_t load_u32(const std::uint8_t* bytes) {
  std::uint32_t word = 0;
  for (int i = 0; i < 4; ++i) word = word << 8 | bytes[i];
  return word;
}
inline std::uint64_t load_u64(const std::uint8_t* bytes) {
  return std::uint64_t{load_u32(bytes)} << 32 | load_u32(bytes + 4);
}
inline void store_u32(std::uint8_t* bytes, std::uint32_t word) {
  for (int i = 0; i < 4; ++i) bytes[i] = static_cast<std::uint8_t>(word >> (24 - 8 * i));
}
inline void store_u64(std::uint8_t* bytes, std::uint64_t word) {
  store_u32(bytes, static_cast<std::uint32_t>(word >> 32));
  store_u32(bytes + 4, static_cast<std::uint32_t>(word));
}

}  // namespace tiller
