#pragma once

#include <cstdint>

namespace tiller {

/// The lowest `count` bits, 0..32.
constexpr std::uint32_t low_bits(std::uint32_t count) { return count < 32 ? (1u << count) - 1u : ~0u; }

/// How many are set.
constexpr std::uint32_t bit_count(std::uint64_t set) {
  std::uint32_t count = 0;
  for (; set != 0; set &= set - 1) ++count;
  return count;
}

constexpr std::uint32_t round_up(std::uint32_t value, std::uint32_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace tiller
