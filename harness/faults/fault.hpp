#pragma once

#include <memory>
#include <vector>

#include "harness/faults/fault_world.hpp"

namespace tiller::faults {

class Device;
class Link;

/// How a run with the fault must end.
enum class End {
  kStops,   ///< the motor is at its safe command within the timeout below plus two ticks, and stays there
  kRides,   ///< the controller stays in motion: the fault is noticed, and does no harm
  kBounded  ///< either, as chance has it; what holds always holds (see judge in fault_run.cpp)
};

/// The configured time after which the fault must have stopped the motor. The generic answers serve where a fault may
/// also ride: nothing moves the motor for longer than that without a genuine reading.
enum class Timeout {
  kNow,
  kSensor,     ///< sensor_timeout_s
  kBadTicks,   ///< bad_ticks_to_safe periods
  kUntaken,    ///< twice as many: every other one restarts the filters
  kFrozen,     ///< two windows of frozen_ticks
  kHold,       ///< hold_ticks_to_safe periods
  kLatePlans,  ///< half a horizon of plans moved on, then HOLD
  kHeartbeat,  ///< heartbeat_timeout of a motor on the bus
  kWatchdog,   ///< of the device
  kPlanWatch   ///< of the device: plan_timeout, then its watchdog
};
std::int64_t timeout_us(Timeout timeout, const Setup& setup);
const char* name_of(Timeout timeout);

/// One kind of fault. Functions may be null; all but `prepare` are called from the fault's first tick on.
struct Fault {
  const char* name;
  const char* group;
  const char* what;  ///< one line for the table of docs/evidence/faults.md
  Route route;
  End end;
  Timeout timeout;
  const char* answer;  ///< what tiller does, for the same table

  void (*prepare)(Setup&) = nullptr;
  void (*step)(World&) = nullptr;                                 ///< before everything else of a tick
  bool (*measure)(World&, tiller_measurement_t&) = nullptr;       ///< memory: changes the reading; false: lost
  void (*frames)(World&, std::vector<CanFrame>&) = nullptr;       ///< bus: from the plant
  void (*commands)(World&, std::vector<CanFrame>&) = nullptr;     ///< bus: from the controller
  void (*packets)(World&, std::vector<Packet>&) = nullptr;        ///< LCM: from the plant
  bool (*noticed)(const World&, const tiller_info_t&) = nullptr;  ///< kRides: the fault has left its mark
  double genuine_sd = 8.0;    ///< a reading farther from the truth than so many sensor deviations is not genuine
  int lasts_ticks = 1 << 30;  ///< then it is over
  std::unique_ptr<Link> (*link)(const Setup&, Device&) = nullptr;  ///< Route::kSocket: how the ends are wired
};

/// Every kind: sensors and time, planner and posterior, operator and actuator, CAN, drives, LCM.
const std::vector<Fault>& all_faults();
std::vector<Fault> sensor_faults();
std::vector<Fault> planner_faults();
std::vector<Fault> device_faults();
std::vector<Fault> bus_faults();
std::vector<Fault> drive_faults();
std::vector<Fault> lcm_faults();

/// Outcome of a run.
struct Outcome {
  const char* wrong = nullptr;  ///< null: as it must be; else the first thing that was not
  double wrong_s = 0.0;         ///< when, since the fault began
  double stopped_s = -1.0;      ///< from the fault's first tick to the motor's last force; -1: it was not stopped
  tiller_status_t status = tiller_status_ok;  ///< what led to SAFE or HOLD
  tiller_state_t state = tiller_state_init;   ///< at the end
};

/// One run, in lockstep in this process: the plant goes on for a random time, then the fault begins.
Outcome run_fault(const Fault& fault, Robot robot, std::uint64_t seed);

}  // namespace tiller::faults
