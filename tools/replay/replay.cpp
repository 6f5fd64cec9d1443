#include "tools/replay/replay.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "tiller/config.hpp"
#include "tools/logs/run_log.hpp"
#include "tools/robot/calibration.hpp"
#include "tools/robot/in_motion.hpp"

namespace tiller::tools {
namespace {

struct FreeBlock {
  void operator()(void* block) const { std::free(block); }
};

/// Periods that a calibration had which began before the tick: those left, and that of the tick where it moved.
std::uint32_t periods_at(const RecordEntry& entry) {
  return entry.probe.calibration_left + (in_motion(entry.record.command.state) ? 1 : 0);
}

/// Calls of the host on the controller before the tick, in their order. False: more than the record keeps.
bool repeat_calls(const RobotFile& robot, tiller_t* controller, const RecordEntry& entry) {
  bool set_goal = false;
  for (std::uint32_t calls = entry.record.calls; calls != 0; calls >>= 4) {
    switch (calls & 15u) {
      case tiller_call_arm: (void)tiller_arm(controller); break;
      case tiller_call_disarm: (void)tiller_disarm(controller); break;
      case tiller_call_stop: (void)tiller_stop(controller, static_cast<tiller_status_t>(entry.stop_status)); break;
      case tiller_call_reset: (void)tiller_reset(controller); break;
      case tiller_call_prepare: (void)tiller_prepare(controller); break;
      case tiller_call_calibrate:
        if (start_calibration(robot, periods_at(entry), controller) != tiller_status_ok) return false;
        break;
      case tiller_call_goal:  // once for all: of several in a row the last one counts
        if (set_goal) break;
        if ((entry.goal & kGoalStates) != 0) (void)tiller_set_target(controller, entry.target);
        if ((entry.goal & kGoalOutputs) != 0) (void)tiller_set_output_target(controller, entry.output_target);
        if (entry.goal == 0) return false;
        set_goal = true;
        break;
      default: return false;
    }
  }
  return true;
}

/// Objects that the record's configuration points to are not in the record: they are taken from the robot file. False
/// where that is another task.
bool take_pointers(const RobotFile& robot, Config& config) {
  const tiller_cost_config_t& from = robot.config.cost;
  tiller_cost_config_t& to = config.cost;
  config.model = robot.config.model;
  if (to.reference_steps != from.reference_steps || to.demonstration_steps != from.demonstration_steps) return false;
  to.reference = from.reference;
  to.demonstration_mean = from.demonstration_mean;
  to.demonstration_root = from.demonstration_root;
  to.own = from.own;
  if (to.output_count != from.output_count || to.output_reference_steps != from.output_reference_steps) return false;
  to.outputs = from.outputs;
  to.output_reference = from.output_reference;
  return true;
}

void compare(const RobotFile& robot, const RecordedRun& run, std::size_t index, const tiller_command_t& replayed,
             const tiller_info_t& info, double tolerance, ReplayResult& result) {
  const RecordEntry& entry = run.entries[index];
  double apart = result.largest;
  const bool same = same_command(entry.record.command, replayed, robot.config.model->input_count, tolerance, apart);
  if (is_behind_a_hole(run, index, same, result)) return;
  result.largest = apart;
  const auto note = [&](Divergence& first) {
    if (first.found) return;
    first.found = first.has_info = true;
    first.at = index;
    first.replayed = replayed;
    first.info = info;
  };
  const std::size_t state_bytes = robot.config.model->state_count * sizeof(double);
  const bool estimated = !std::isnan(entry.record.state_mean[0]);  // a log without telemetry has none
  if (estimated && std::memcmp(entry.record.state_mean, info.state_mean, state_bytes) != 0) note(result.first_estimate);
  ++result.ticks;
  if (same) return;
  ++result.different;
  note(result.first);
}

std::uint64_t bits_of(double v) {
  std::uint64_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  return bits;
}

std::string bits_text(double v) { return format("%.17g", v); }

}  // namespace

bool same_command(const tiller_command_t& a, const tiller_command_t& b, std::uint32_t inputs, double tolerance,
                  double& difference) {
  bool same = a.state == b.state || a.state == kStateUnknown;
  for (std::uint32_t i = 0; i < inputs; ++i) {
    const double apart = std::fabs(a.value[i] - b.value[i]);
    if (!(apart <= difference)) difference = apart;
    // NaN is within no tolerance
    if (tolerance > 0 ? !(apart <= tolerance) : bits_of(a.value[i]) != bits_of(b.value[i])) same = false;
  }
  return same;
}

bool is_behind_a_hole(const RecordedRun& run, std::size_t index, bool same, ReplayResult& result) {
  if (index < sound_ticks(run)) return false;
  ++result.behind;
  if (!same) ++result.behind_different;
  return true;
}

bool replay_through_file(const RobotFile& robot, RecordedRun& run, const ReplayOptions& options, ReplayResult& result,
                         std::string& error) {
  Config config = run.has_config ? run.config : robot.config;
  if (run.has_config && !take_pointers(robot, config)) {
    error = "the reference, the demonstration or the outputs' cost of " + robot.path + " has another length by now";
    return false;
  }
  config.record_ticks = 0;
  const std::size_t size = tiller_size(&config);
  if (size == 0) {
    error = "its configuration does not fit the model of " + robot.path;
    return false;
  }
  std::unique_ptr<void, FreeBlock> block(
      std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT));
  tiller_t* controller = nullptr;
  const tiller_status_t status = tiller_init(&controller, &config, nullptr, block.get(), size);
  if (status != tiller_status_ok) {
    error = tiller_status_text(status);
    return false;
  }
  const auto begin = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < run.entries.size(); ++i) {
    const RecordEntry& entry = run.entries[i];
    const tiller_record_t& r = entry.record;
    if (options.real_time)
      std::this_thread::sleep_until(begin + std::chrono::microseconds(r.now_us - run.entries[0].record.now_us));
    if (!repeat_calls(robot, controller, entry)) ++result.lost_calls;
    if (r.planner_iterations != kIterationsUnknown) (void)tiller_force_iterations(controller, r.planner_iterations);
    tiller_command_t command;
    (void)tiller_tick(controller, r.now_us, r.has_measurement ? &r.measurement : nullptr, &command);
    tiller_info_t info{};
    tiller_get_info(controller, &info);
    compare(robot, run, i, command, info, options.tolerance, result);
    if (options.watch) options.watch(controller, entry, info);
  }
  return true;
}

std::string divergence_text(const RobotFile& robot, const RecordedRun& run, const ReplayResult& result) {
  const Divergence& first = result.first;
  if (!first.found) return "";
  const tiller_record_t& r = run.entries[first.at].record;
  const double time_s = 1e-6 * static_cast<double>(r.now_us - run.entries[0].record.now_us);
  const auto state = [](std::uint32_t s) {
    return s == kStateUnknown ? "without a state" : tiller_state_name(static_cast<tiller_state_t>(s));
  };
  std::string text =
      format("first difference in tick %llu, at %.6f s", static_cast<unsigned long long>(r.tick), time_s);
  if (first.silent) return text + ": no answer\n";
  text += format(": recorded %s, replayed %s\n", state(r.command.state), state(first.replayed.state));
  const auto row = [&](const char* what, const std::string& name, double recorded, double replayed) {
    text += format("  %-9s %-20s recorded %-24s replayed %s%s\n", what, name.c_str(), bits_text(recorded).c_str(),
                   bits_text(replayed).c_str(),
                   recorded == replayed ? "" : format("  (%+.3g)", replayed - recorded).c_str());
  };
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i)
    row("command", robot.names.inputs[i], r.command.value[i], first.replayed.value[i]);
  for (std::size_t i = 0; r.has_measurement != 0 && i < robot.names.measurements.size(); ++i)
    text += format("  measured  %-20s %s\n", robot.names.measurements[i].c_str(),
                   bits_text(r.measurement.value[i]).c_str());
  if (r.has_measurement == 0) text += "  measured  nothing new\n";
  for (std::size_t i = 0; first.has_info && i < robot.names.states.size(); ++i)
    row("state", robot.names.states[i], r.state_mean[i], first.info.state_mean[i]);
  for (std::size_t i = 0; first.has_info && i < robot.names.params.size(); ++i)
    if (robot.config.priors[i].kind != tiller_prior_fixed)
      row("parameter", robot.names.params[i], r.param_mean[i], first.info.param_mean[i]);
  if (!first.has_info) return text;
  const Words forces = felt_forces(robot.config);
  for (std::size_t j = 0; run.entries[first.at].force_joints > 0 && j < forces.size(); ++j)
    row("force", forces[j], run.entries[first.at].force_mean[j], first.info.force_mean[j]);
  text +=
      format("  status    recorded %s, replayed %s; iterations %s, %u\n",
             tiller_status_name(static_cast<tiller_status_t>(r.status)),
             tiller_status_name(static_cast<tiller_status_t>(first.info.status)),
             r.planner_iterations == kIterationsUnknown ? "not logged" : std::to_string(r.planner_iterations).c_str(),
             first.info.planner_iterations);
  if (result.first_estimate.found && result.first_estimate.at < first.at)
    text += format("  the estimate of the state differs from tick %llu on\n",
                   static_cast<unsigned long long>(run.entries[result.first_estimate.at].record.tick));
  return text;
}

}  // namespace tiller::tools
