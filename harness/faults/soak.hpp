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
  /// Something happens every few seconds (SoakEvent); what is believed is asked for in every tick, and the posterior
  /// takes in a force and learns again. About 100 us a tick.
  bool eventful = false;
  /// Moves of particles a tick (tiller_posterior_config_t::moves_per_tick); without any nothing is learnt again, and an
  /// eventful tick takes about 20 us.
  std::uint32_t moves = 8;
  bool progress = false;  ///< a line on stderr at every twentieth of the ticks
};

/// What happens in an eventful soak, each for a while, the next some seconds later.
enum class SoakEvent {
  drifting_clock,  ///< the sensor's stamps fall behind by 0.7 %, then leap back
  stamps_back,     ///< two readings carry stamps of five seconds ago
  clocks_ahead,    ///< both clocks leap by an hour
  clocks_back,     ///< both clocks leap back by a minute
  short_silence,   ///< no reading for 50 ms
  long_silence,    ///< none for half a second: SAFE, then somebody resets it
  other_mass,      ///< the bob's mass is another from now on
  push,            ///< a torque that the model lacks
  not_a_number,    ///< one reading is NaN, the next infinite
  spike,           ///< one reading is off by a radian
  disarmed,        ///< by the host, for a second
  stopped,         ///< by the host
  other_goal,      ///< a few degrees beside upright
  bad_calls,       ///< goals and inputs that are no values, in the middle of the run
  count
};
const char* name_of(SoakEvent event);

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
  // of an eventful soak
  std::uint64_t events[static_cast<int>(SoakEvent::count)] = {};
  std::uint64_t unsafe = 0;  ///< commands that are not finite, beyond a limit, or in SAFE not the safe one
  std::uint64_t resets = 0;  ///< after SAFE
  /// Times that it was not ACTIVE and near upright when the next event was due; by the event before.
  std::uint64_t unrecovered = 0, unrecovered_after[static_cast<int>(SoakEvent::count)] = {};
  std::uint64_t settled = 0;     ///< ticks 3 s or more after an event, and of these
  std::uint64_t deceived = 0;    ///< with a mass that is off by a tenth and by four deviations
  std::uint64_t taken = 0;       ///< calls with what is no value that were not refused
  std::uint64_t relearned = 0;   ///< times that the posterior began again
  std::uint64_t not_finite = 0;  ///< ticks with a belief that is not finite
};

/// A pendulum held upright for all that time, its plant an equation of its own (RK4 at 2 ms). About 20 us a tick.
SoakOutcome run_soak(const SoakCase& soak);

}  // namespace tiller::faults
