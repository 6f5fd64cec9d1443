// Faults of the operator and the drive, and commands that get lost behind the controller.

#include "harness/faults/fault.hpp"

namespace tiller::faults {
namespace {

void operators(std::vector<Fault>& list) {
  const char* group = "operator";
  list.push_back(
      {"emergency_stop", group, "tiller_stop is called", Route::kMemory, End::kStops, Timeout::kNow, "SAFE at once"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) (void)tiller_stop(w.controller, tiller_status_stopped);
  };
  list.push_back({"actuator_fault_told", group, "the host reports a fault of the drive", Route::kMemory, End::kStops,
                  Timeout::kNow, "SAFE at once"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) (void)tiller_stop(w.controller, tiller_status_actuator_fault);
  };
  list.push_back({"disarmed", group, "tiller_disarm is called", Route::kMemory, End::kStops, Timeout::kNow,
                  "STANDBY: the safe command"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) (void)tiller_disarm(w.controller);
  };
  list.push_back({"armed_again_and_again_in_safe", group, "somebody arms at every tick after a stop", Route::kMemory,
                  End::kStops, Timeout::kNow, "SAFE latches: arming is refused"});
  list.back().step = [](World& w) {
    if (w.ticks == 0) (void)tiller_stop(w.controller, tiller_status_stopped);
    (void)tiller_arm(w.controller);
  };
  list.push_back({"reset_in_motion", group, "somebody calls tiller_reset while it moves", Route::kMemory, End::kRides,
                  Timeout::kSensor, "refused: `wrong_state`"});
  list.back().step = [](World& w) {
    if (tiller_reset(w.controller) == tiller_status_wrong_state) w.amount += 1.0;
  };
  list.back().noticed = [](const World& w, const tiller_info_t&) { return w.amount > 10.0; };
  list.push_back({"stopped_after_sensor_fault", group, "the sensors die, then somebody arms", Route::kMemory,
                  End::kStops, Timeout::kSensor, "SAFE latches: arming is refused"});
  list.back().step = [](World& w) { (void)tiller_arm(w.controller); };
  list.back().measure = [](World& w, tiller_measurement_t&) { return w.ticks > 20; };
}

void commands(std::vector<Fault>& list) {
  const char* group = "commands";
  list.push_back({"commands_lost", group, "no command reaches the device", Route::kMemory, End::kStops,
                  Timeout::kWatchdog, "the device's watchdog"});
  list.back().step = [](World& w) { w.command_lost = true; };
  list.push_back({"some_commands_lost", group, "three of ten commands are lost", Route::kMemory, End::kBounded,
                  Timeout::kSensor, "the device holds the last one, at most until its watchdog"});
  list.back().step = [](World& w) { w.command_lost = w.random.chance(0.3); };
  list.push_back({"controller_pauses", group, "no tick for 0.3 s, then on as if nothing had been", Route::kMemory,
                  End::kStops, Timeout::kWatchdog, "the device's watchdog; then `sensor_stale`, SAFE"});
  list.back().step = [](World& w) { w.hung = w.ticks < 15; };
  list.push_back({"saturated_plan", group, "limits and rates a tenth of what the plan needs", Route::kMemory,
                  End::kBounded, Timeout::kSensor, "the gate cuts: `command_limited`, `rate_limited`"});
  list.back().prepare = [](Setup& s) {
    s.config.safety.input_low[0] *= 0.1;
    s.config.safety.input_high[0] *= 0.1;
    s.config.safety.input_rate_per_s[0] *= 0.02;
  };
}

}  // namespace

std::vector<Fault> device_faults() {
  std::vector<Fault> list;
  operators(list);
  commands(list);
  return list;
}

}  // namespace tiller::faults
