#pragma once

#include "harness/faults/fault_world.hpp"

namespace tiller::faults {

/// A bus that loses frames and holds others back.
struct LossCase {
  double loss = 0.1;              ///< share of all frames, both ways
  std::int64_t jitter_us = 5000;  ///< each frame is late by 0..jitter, so they overtake one another
  double seconds = 20.0;
};

struct LossOutcome {
  bool up = false;                 ///< within 0.3 rad of upright for the second half
  double most_off_rad = 0.0;       ///< largest angle from upright in the second half
  bool safe = false;               ///< it went to SAFE
  double worst_age_s = 0.0;        ///< of the reading behind a command that drives the motor, when it is sent
  double worst_motor_age_s = 0.0;  ///< and while the motor obeys it
  std::uint64_t stale = 0;         ///< commands in motion whose newest reading was older than sensor_timeout_s
  std::uint64_t missed = 0;        ///< ticks without a measurement
};

/// The pendulum swings up and stays up over an emulated bus; one run at a millisecond's resolution. A tick follows each
/// measurement, or comes half a period late without one, as `tiller run` does it. Timeouts of sensors, heartbeat and
/// device are 0.2 s.
LossOutcome run_loss(const LossCase& loss, std::uint64_t seed);

}  // namespace tiller::faults
