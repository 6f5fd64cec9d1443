#include "tools/explain/remedies.hpp"

#include <algorithm>
#include <iterator>

namespace tiller::tools {
namespace {

struct Remedy {
  tiller_status_t status;
  const char* text;
};

constexpr Remedy kRemedies[] = {
    {tiller_status_sensor_stale,
     "check the cable, the bus and the sender's rate, and that its stamps are of the tick's clock; a sender that is "
     "slow by design needs a longer [safety] sensor_timeout_s"},
    {tiller_status_sensor_not_finite,
     "check the driver that sends NaN or infinity; [safety] bad_ticks_to_safe sets how many readings in a row may be "
     "refused"},
    {tiller_status_sensor_out_of_range,
     "check unit and zero of the sensor; if the value is right, widen low and high of it in [measurement]"},
    {tiller_status_sensor_jump,
     "check the encoder for slips and lost counts; if the robot moves that fast, raise rate_per_s of it in "
     "[measurement]"},
    {tiller_status_sensor_frozen,
     "check whether the sensor stopped, or the motor has no power; [safety] frozen_ticks sets how long readings may "
     "repeat"},
    {tiller_status_time_backwards,
     "check for two senders on one channel, and for a clock that was set; with a clock of the sender's own, set "
     "[transport] stamp_on_arrival = true"},
    {tiller_status_plan_not_finite,
     "run `tiller check` on the robot file: a cost that is not finite at some state, or a step that is too long "
     "([model] substeps)"},
    {tiller_status_posterior_degenerate,
     "the model divides by zero, or its step is too long: `tiller check`, more [model] substeps; a prior that excludes "
     "the robot: widen it in [parameters]"},
    {tiller_status_command_not_finite,
     "a gain or a plan is not finite: check [safety] hold_gain and the model, and report it if both are right"},
    {tiller_status_transport_closed, "check whether the other end runs, and [transport] of the robot file"},
    {tiller_status_bus_off, "check termination, bit rate and wiring of the bus: `tiller can doctor`"},
    {tiller_status_actuator_fault,
     "ask the drive's own tool for its fault; docs/evidence/faults.md tells what each of them does"},
    {tiller_status_stopped, "whoever called tiller_stop knows why: an emergency stop, or a program of the robot's"},
    {tiller_status_io_error, "the kernel's log tells more: `dmesg`; check the interface of [transport]"},
    {tiller_status_bad_message, "check that both ends are of one version and share [transport] of one robot file"},
    {tiller_status_state_not_finite,
     "the model divides by zero, or its step is too long: `tiller check`, more [model] substeps"},
    {tiller_status_contact,
     "if nobody touched the robot, the model lacks a force as large: `tiller gap` names it; else raise [safety] "
     "contact_force, and see contact_action"},

    {tiller_status_command_limited,
     "the plan leaves the limits by more than rounding: check low and high in [limits], and [[safety.cones]]"},
    {tiller_status_rate_limited,
     "the plan wants to change the command faster: raise [cost] input_rate_weight, or rate_per_s in [limits] if the "
     "drive allows it"},
    {tiller_status_deadline_missed,
     "halve [planner] rollouts, particles or horizon, or raise deadline_us; `tiller check` predicts the time of a "
     "tick"},
    {tiller_status_no_new_measurement,
     "the sender is slower than the ticks, or messages are lost: set [model] period_s to the sender's period"},
    {tiller_status_tempered, "nothing: the data tell much at once, and the posterior takes them in over several ticks"},
    {tiller_status_iteration_capped,
     "nothing, if the robot moves well; else lower [planner] iterations, rollouts or horizon, or raise deadline_us"},
    {tiller_status_queue_full, "write the log to a faster disk"},
    {tiller_status_record_overwritten, "raise [recorder] ticks, or read the ring more often"},
    {tiller_status_bounds_relaxed,
     "no way within the bounds was found: begin inside of them, widen [cost] bounds, or lengthen [planner] horizon"},
    {tiller_status_program_unsolved, "loosen [cost] bounds; try the other [planner] qp_solver, or a shorter horizon"},
    {tiller_status_model_inadequate,
     "run `tiller gap` on this log and two more: it names the missing effect (docs/theory/adequacy.md)"},
    {tiller_status_measurement_outlier,
     "check the sensor for spikes; if they are its ordinary noise, raise its sd in [measurement]"},
};

}  // namespace

const char* remedy_for(tiller_status_t status) {
  const auto* const found = std::find_if(std::begin(kRemedies), std::end(kRemedies),
                                         [&](const Remedy& remedy) { return remedy.status == status; });
  return found == std::end(kRemedies) ? "" : found->text;
}

}  // namespace tiller::tools
