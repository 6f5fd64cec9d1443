#pragma once

#include <time.h>

#include <cstdint>

namespace tiller {

/// Microseconds of CLOCK_MONOTONIC: the clock of stamps made on this machine.
inline std::int64_t monotonic_us() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1000000 + now.tv_nsec / 1000;
}

}  // namespace tiller
