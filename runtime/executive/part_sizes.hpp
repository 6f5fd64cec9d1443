#pragma once

#include <cstddef>
#include <cstdint>

#include "core/arena.hpp"

namespace tiller {

/// Bytes of the block that each part of a controller takes, in the order in which they lie. Filled by the layout
/// itself, so that it cannot disagree with what is laid out.
struct PartSizes {
  static constexpr std::uint32_t kMost = 16;
  struct Part {
    const char* name;
    std::size_t bytes;
  };

  Part part[kMost] = {};
  std::uint32_t count = 0;

  /// Memory that the arena gave since the last call belongs to `name`.
  void note(const char* name, const Arena& arena) {
    if (count < kMost) part[count++] = {name, arena.used() - before_};
    before_ = arena.used();
  }

 private:
  std::size_t before_ = 0;
};

}  // namespace tiller
