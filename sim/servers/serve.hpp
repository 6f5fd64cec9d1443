#pragma once

#include <csignal>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "sim/plant/plant.hpp"

namespace tiller::sim {

/// One reading of all encoders, as it leaves the plant.
struct PlantMeasurement {
  std::int64_t stamp_us;      ///< when the encoders were read
  std::uint32_t sequence;     ///< 0, 1, 2, ...
  std::vector<double> value;  // (measurements)
  /// Real time: mean time from the stamp of a measurement to the arrival of its command; 0: not known yet. In lockstep
  /// a command arrives at the stamp.
  std::int64_t answer_us = 0;
};

/// One command, as it reaches the plant.
struct PlantCommand {
  static constexpr std::int64_t kUnnumbered = -1;  ///< a bare motor command: acts, but answers nothing
  std::int64_t sequence = kUnnumbered;             ///< of the measurement that it answers
  std::vector<double> value;                       // (commands)
  bool has_value = true;                           ///< false: an answer only, the motor has got its command before
  std::int32_t state = -1;                         ///< of the controller: 2 active, 3 hold; -1: not told
  std::int64_t plan = kUnnumbered;                 ///< number of the plan, or its low bits; kUnnumbered: not told
};

/// How measurements leave and commands arrive: LCM, a CAN bus, or a test's own.
class PlantLink {
 public:
  virtual ~PlantLink() = default;
  /// False with a reason in error() when the link is gone for good; a full queue is not such a case.
  virtual bool publish(const PlantMeasurement& measurement) = 0;
  /// Waits at most timeout_us (0: only looks) for the next command, in the order of arrival.
  virtual bool receive(PlantCommand& command, std::int64_t timeout_us) = 0;
  virtual std::string error() const = 0;  ///< empty while the link works
  /// Whether a message may be lost on the way without a word, so that it is worth asking again.
  virtual bool is_lossy() const { return true; }
  /// After every period: what a device sends on its own, and what it learns from its watchdog.
  virtual void after_period(const Plant& /*plant*/) {}
};

struct ServeOptions {
  double period_s = 0.02;
  /// Lockstep: simulated time waits for the answer to each measurement. Real time: it follows the wall clock.
  bool lockstep = true;
  /// Lockstep: wall time to wait for an answer; then simulated time goes on without it and the watchdog
  /// counts. Before the first answer there is no such limit.
  double answer_timeout_s = 1.0;
  /// Lockstep: wall time after which a measurement without an answer is sent again, the same with the same sequence.
  /// On a link that is not lossy, only until the first answer: somebody may have to start the controller yet.
  double repeat_s = 0.1;
  /// Lockstep: simulated time runs at most this many times as fast as the wall clock; 0: as fast as both sides compute,
  /// which is more than a listener's socket may hold when the machine is busy.
  double pace = 0;
  double plan_timeout_s = 1.0;  ///< ACTIVE without a new plan for this long: motor off; 0: for ever
  double duration_s = 0;        ///< simulated; 0: until stop
  const volatile std::sig_atomic_t* stop = nullptr;  ///< serve returns soon after this becomes non-zero
  std::function<std::int64_t()> now_us;              ///< any clock that never goes back; empty: CLOCK_MONOTONIC
  /// Called after each period, for traces and progress; may be empty.
  std::function<void(const Plant&, const PlantMeasurement&)> on_period;
};

/// Outcome, for the caller to print.
struct ServeReport {
  std::uint64_t periods = 0;
  std::uint64_t commands = 0;         ///< applied
  std::uint64_t repeats = 0;          ///< lockstep: measurements sent again, for want of an answer
  std::uint64_t missing_answers = 0;  ///< lockstep: periods that went on without one
  std::uint64_t stale_commands = 0;   ///< lockstep: answers to another measurement, ignored
  std::uint64_t bad_commands = 0;     ///< wrong count or not finite, ignored
  std::uint64_t hung_commands = 0;    ///< without a new plan for plan_timeout_s, ignored
  std::uint64_t late_periods = 0;     ///< real time: periods that began more than one period late
  std::string error;                  ///< empty: ended by duration or stop
};

/// Serves the plant until the duration is over, stop is set or the link fails. Returns 0, or 1 with the
/// reason in report.error. In real time stamps are CLOCK_MONOTONIC, so a runtime on the same machine can tell
/// the age of a reading; in lockstep they are simulated time, starting at one second so that none is
/// negative.
int serve(Plant& plant, PlantLink& link, const ServeOptions& options, ServeReport& report);

}  // namespace tiller::sim
