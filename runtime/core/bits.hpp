#pragma once

#include <cstdint>

namespace tiller {

/// The lowest `count` bits, 0..32.
constexpr std::uint32_t low_bits(std::uint32_t count) { return count < 32 ? (1u << count) - 1u : ~0u; }

}  // namespace tiller
