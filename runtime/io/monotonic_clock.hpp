#pragma once

#include <time.h>

#include <cstdint>

namespace tiller {

inline std::int64_t clock_us(clockid_t clock) {
  timespec now;
  clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1000000 + now.tv_nsec / 1000;
}

/// Microseconds of CLOCK_MONOTONIC: the clock of stamps made on this machine.
inline std::int64_t monotonic_us() { return clock_us(CLOCK_MONOTONIC); }

/// Microseconds of CLOCK_REALTIME: the clock by which the kernel stamps what arrives.
inline std::int64_t realtime_us() { return clock_us(CLOCK_REALTIME); }

}  // namespace tiller
