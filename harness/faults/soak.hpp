#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::faults {

/// A long run in lockstep, over the transport in memory.
struct SoakCase {
  std::uint64_t ticks = 8640000;  ///< 24 h at 100 Hz
  /// Where numbers begin: so that they wrap, and stamps pass 2^32 us, on the way.
  std::uint32_t first_sequence = 0;
  std::int64_t first_stamp_us = 1000000;
};

struct SoakOutcome {
  std::uint64_t ticks = 0;
  std::uint64_t hash = 0;        ///< of every bit of every command
  std::uint64_t faults = 0;      ///< ticks with a status of the fault band
  std::uint64_t not_active = 0;  ///< ticks in any other state
  std::uint64_t unanswered = 0;  ///< commands that answer another measurement
  tiller_status_t first_fault = tiller_status_ok;
  std::int64_t heap_growth_bytes = 0;  ///< from the thousandth tick to the last
  std::int64_t resident_growth_bytes = 0;
  std::int64_t own_growth_bytes = 0;  ///< of that: not pages of the program's files
  double worst_angle_rad = 0.0;       ///< from upright, after the first second
};

/// A pendulum held upright for all that time, its plant an equation of its own (RK4 at 2 ms). About 20 us a tick.
SoakOutcome run_soak(const SoakCase& soak);

}  // namespace tiller::faults
