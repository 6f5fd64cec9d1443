#include "tools/explain/happenings.hpp"

#include <algorithm>
#include <cmath>

#include "tools/explain/evidence.hpp"
#include "tools/robot/in_motion.hpp"

namespace tiller::tools {
namespace {

bool is_of_sensors(tiller_status_t status) {
  return status >= tiller_status_sensor_stale && status <= tiller_status_time_backwards;
}

HappeningKind kind_of(tiller_status_t status) {
  if (status < 200) return HappeningKind::refused;
  switch (status) {
    case tiller_status_command_limited:
    case tiller_status_rate_limited: return HappeningKind::clipped;
    case tiller_status_deadline_missed:
    case tiller_status_iteration_capped: return HappeningKind::late;
    case tiller_status_no_new_measurement:
    case tiller_status_measurement_outlier: return HappeningKind::refused;
    case tiller_status_tempered: return HappeningKind::ordinary;
    default: return HappeningKind::doubted;
  }
}

class Walk {
 public:
  Walk(const RobotFile& robot, const tiller_config_t& config, const RecordedRun& run)
      : robot_(robot), config_(config), run_(run) {}

  std::vector<Happening> take_all() {
    for (at_ = 0; at_ < run_.entries.size(); ++at_) take_tick();
    std::stable_sort(found_.begin(), found_.end(),
                     [](const Happening& a, const Happening& b) { return a.kind < b.kind; });
    return found_;
  }

 private:
  const RecordEntry& entry() const { return run_.entries[at_]; }
  const tiller_record_t& record() const { return entry().record; }
  tiller_status_t status() const { return static_cast<tiller_status_t>(record().status); }
  std::uint32_t state() const { return record().command.state; }

  Happening& note(HappeningKind kind, tiller_status_t why, std::size_t channel = 0) {
    auto found = std::find_if(found_.begin(), found_.end(), [&](const Happening& h) {
      return h.kind == kind && h.status == why && h.channel == channel;
    });
    if (found == found_.end()) {
      Happening fresh;
      fresh.kind = kind, fresh.status = why, fresh.channel = channel, fresh.first = at_;
      fresh.evidence = evidence_of(robot_, config_, run_, at_, why, sensors_);
      found = found_.insert(found_.end(), fresh);
    }
    if (found->ticks == 0 || found->last + 1 != at_) ++found->spans;
    ++found->ticks;
    found->last = at_;
    return *found;
  }

  void take_tick() {
    note_state();
    note_values();
    note_command();
    note_time();
    // where the state is not the reason's, the status tells whether the measurement was taken in
    const bool taken = state() != tiller_state_safe && !is_of_sensors(status());
    if (record().has_measurement != 0 && taken) sensors_.take(entry(), at_, robot_.names.measurements.size());
  }

  void note_state() {
    const bool safe = state() == tiller_state_safe;
    if (safe || state() == tiller_state_hold) {
      note(safe ? HappeningKind::safe : HappeningKind::held, status());
      return;
    }
    if (status() != tiller_status_ok) note(kind_of(status()), status());
    // the first limit of a tick is its status: a posterior that takes in data in steps hides a planner without time
    if (status() != tiller_status_tempered || state() != tiller_state_active || deadline_us() <= 0) return;
    if (record().planner_iterations == 0) note(HappeningKind::late, tiller_status_deadline_missed);
  }

  /// 0: none, as in simulated time.
  double deadline_us() const { return deadline_of(config_, run_); }

  void note_time() {
    const double took_s = 1e-9 * static_cast<double>(record().tick_ns);
    if (deadline_us() <= 0 || took_s <= 1e-6 * deadline_us()) return;
    Happening& overran = note(HappeningKind::overran, tiller_status_deadline_missed);
    overran.longest_s = std::max(overran.longest_s, took_s);
  }

  /// Single values that a measurement lacked.
  void note_values() {
    if (record().has_measurement == 0 || is_of_sensors(status()) || state() == tiller_state_safe) return;
    for (std::size_t k = 0; k < robot_.names.measurements.size(); ++k)
      if (std::isnan(record().measurement.value[k])) note(HappeningKind::missing, tiller_status_ok, k);
  }

  /// Commands that stand at a limit: the planner's own choice, or the gate's.
  void note_command() {
    if (!in_motion(state())) return;
    const bool moved_before = at_ > 0 && in_motion(run_.entries[at_ - 1].record.command.state);
    const tiller_safety_config_t& limits = config_.safety;
    for (std::size_t i = 0; i < robot_.names.inputs.size(); ++i) {
      const double grain = 1e-6 * (limits.input_high[i] - limits.input_low[i]);  // as the gate's
      const double u = record().command.value[i];
      if (u <= limits.input_low[i] + grain || u >= limits.input_high[i] - grain)
        note(HappeningKind::at_limit, tiller_status_ok, 2 * i);
      if (!moved_before || !std::isfinite(limits.input_rate_per_s[i])) continue;
      const RecordEntry& last = run_.entries[at_ - 1];
      const double step_s =
          std::min(1e-6 * static_cast<double>(record().now_us - last.record.now_us), config_.period_s);
      const double most = limits.input_rate_per_s[i] * step_s;
      if (most > 0 && std::fabs(u - last.record.command.value[i]) >= most - grain)
        note(HappeningKind::at_limit, tiller_status_ok, 2 * i + 1);
    }
  }

  const RobotFile& robot_;
  const tiller_config_t& config_;
  const RecordedRun& run_;
  std::size_t at_ = 0;
  SensorMemory sensors_;
  std::vector<Happening> found_;
};

}  // namespace

double deadline_of(const tiller_config_t& config, const RecordedRun& run) {
  return std::isnan(run.deadline_us) ? config.planner.deadline_us : run.deadline_us;
}

std::vector<Happening> find_happenings(const RobotFile& robot, const tiller_config_t& config, const RecordedRun& run) {
  return Walk(robot, config, run).take_all();
}

bool is_remark(const Happening& h) {
  return h.kind >= HappeningKind::at_limit || h.status == tiller_status_iteration_capped;
}

}  // namespace tiller::tools
