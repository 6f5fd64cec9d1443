// The numbers behind a reason: which sensor, which value, which limit.
#include "tools/explain/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tools/base/unit_names.hpp"
#include "tools/logs/run_log.hpp"

namespace tiller::tools {
namespace {

constexpr double kTwoPi = 6.283185307179586;

/// Everything that a sentence is made from.
struct Scene {
  const RobotFile& robot;
  const tiller_config_t& config;
  const RecordedRun& run;
  std::size_t index;
  const SensorMemory& before;

  const RecordEntry& entry() const { return run.entries[index]; }
  const tiller_record_t& record() const { return entry().record; }
  bool has_measurement() const { return record().has_measurement != 0; }
  double value(std::size_t k) const { return record().measurement.value[k]; }
  const std::string& sensor(std::size_t k) const { return robot.names.measurements[k]; }
  std::string unit(std::size_t k) const {
    const std::string unit = unit_of_field(sensor(k));
    return unit.empty() ? "" : " " + unit;
  }
};

double seconds(std::int64_t us) { return 1e-6 * static_cast<double>(us); }

std::string of_measurement(const std::string& sensor, const char* key, double value) {
  return "[measurement] " + sensor + " " + key + " = " + number_text(value);
}

/// One reading's own stamp, or the silence of all or some.
std::string stale_text(const Scene& s) {
  const double timeout_s = s.config.safety.sensor_timeout_s;
  const std::string limit = "[safety] sensor_timeout_s = " + number_text(timeout_s);
  if (s.has_measurement()) {
    const double age_s = seconds(s.record().now_us - s.record().measurement.stamp_us);
    if (age_s > timeout_s) return format("Its stamp was %.3g s older than the tick; ", age_s) + limit;
    if (age_s < -s.config.period_s) return format("Its stamp was %.3g s ahead of the tick: another clock", -age_s);
  }
  if (!s.before.started) return "";
  Words silent;
  for (std::size_t k = 0; k < s.before.value.size(); ++k)
    if (seconds(s.record().now_us - s.before.stamp_us[k]) > timeout_s) silent.push_back(s.sensor(k));
  const double age_s = seconds(s.record().now_us - s.before.last_us);
  if (silent.empty() || silent.size() == s.before.value.size())
    return format("The last reading was taken in %.3g s before, at ", age_s) + place_text(s.run, s.before.last) + "; " +
           limit;
  return "Readings came without " + join(silent) + " (NaN) for longer than " + limit;
}

std::string not_finite_text(const Scene& s) {
  if (!s.has_measurement()) return "";
  Words nan, infinite;
  for (std::size_t k = 0; k < s.robot.names.measurements.size(); ++k) {
    if (std::isnan(s.value(k))) nan.push_back(s.sensor(k));
    if (std::isinf(s.value(k))) infinite.push_back(s.sensor(k));
  }
  if (!infinite.empty()) return join(infinite) + " was infinite";
  if (nan.empty()) return "";
  return join(nan) + " was NaN" + (s.before.started ? "" : ", and the first reading must be complete");
}

std::string range_text(const Scene& s) {
  for (std::size_t k = 0; s.has_measurement() && k < s.robot.names.measurements.size(); ++k) {
    const double v = s.value(k);
    const double* const low = s.config.safety.measurement_low;
    const double* const high = s.config.safety.measurement_high;
    const std::string read = s.sensor(k) + " read " + format("%.6g", v) + s.unit(k);
    if (low && v < low[k]) return read + ", below " + of_measurement(s.sensor(k), "low", low[k]);
    if (high && v > high[k]) return read + ", above " + of_measurement(s.sensor(k), "high", high[k]);
    if (std::fabs(v) > TILLER_LARGEST_VALUE) return read + ", which is no value of a sensor";
  }
  return "";
}

std::string jump_text(const Scene& s) {
  const double* const rate = s.config.safety.measurement_rate_per_s;
  for (std::size_t k = 0; rate && s.has_measurement() && s.before.started && k < s.before.value.size(); ++k) {
    double change = s.value(k) - s.before.value[k];
    if ((s.config.model->angle_mask >> s.config.measured_state[k] & 1u) != 0) change = std::remainder(change, kTwoPi);
    const double time_s = seconds(s.record().measurement.stamp_us - s.before.stamp_us[k]);
    if (!(std::fabs(change) > rate[k] * time_s)) continue;
    return s.sensor(k) + " went from " + format("%.6g to %.6g", s.before.value[k], s.value(k)) + s.unit(k) +
           format(" in %.3g s; ", time_s) + of_measurement(s.sensor(k), "rate_per_s", rate[k]);
  }
  return "";
}

std::string backwards_text(const Scene& s) {
  if (s.index > 0) {
    const std::int64_t step_us = s.record().now_us - s.run.entries[s.index - 1].record.now_us;
    if (step_us < 0) return format("The clock of the ticks went back by %.6g s", -seconds(step_us));
  }
  if (!s.has_measurement() || !s.before.started) return "";
  return format("The stamp was %.6g s behind the one before",
                seconds(s.before.last_us - s.record().measurement.stamp_us));
}

std::string contact_text(const Scene& s) {
  const Words forces = felt_forces(s.config);
  for (std::size_t j = 0; j < forces.size() && j < s.entry().force_joints; ++j) {
    if ((s.entry().touched >> j & 1u) == 0) continue;
    const std::uint32_t velocity = s.config.model->joints[j].velocity;
    return forces[j] + format(" beyond the model was %.3g +- %.2g; ", s.entry().force_mean[j], s.entry().force_sd[j]) +
           "[safety] contact_force " + s.robot.names.states[velocity] + " = " +
           number_text(s.config.safety.contact_force[velocity]);
  }
  return "";
}

std::string deadline_text(const Scene& s) {
  const double deadline_us = s.run.deadline_us > 0 ? s.run.deadline_us : s.config.planner.deadline_us;
  std::string text =
      format("The plan got %u of %u iterations", s.record().planner_iterations, s.config.planner.iterations);
  if (s.record().tick_ns > 0) text += format(", the tick took %.3g ms", 1e-6 * static_cast<double>(s.record().tick_ns));
  return deadline_us > 0 ? text + "; [planner] deadline_us = " + number_text(deadline_us) : text;
}

std::string frozen_text(const Scene& s) {
  return format("%zu readings in a row were the same to the last bit while the model says that the robot moves; ",
                s.before.repeats + 1) +
         format("[safety] frozen_ticks = %u", s.config.safety.frozen_ticks);
}

std::string command_text(const Scene& s) {
  Words values;
  for (std::size_t i = 0; i < s.robot.names.inputs.size(); ++i)
    values.push_back(s.robot.names.inputs[i] + format(" = %.6g", s.record().command.value[i]) + " in [" +
                     number_text(s.config.safety.input_low[i]) + ", " + number_text(s.config.safety.input_high[i]) +
                     "]" +
                     (std::isfinite(s.config.safety.input_rate_per_s[i])
                          ? ", rate_per_s = " + number_text(s.config.safety.input_rate_per_s[i])
                          : ""));
  return "What was sent: " + join(values, "; ");
}

std::string text_of(const Scene& s, tiller_status_t status) {
  switch (status) {
    case tiller_status_sensor_stale: return stale_text(s);
    case tiller_status_sensor_not_finite: return not_finite_text(s);
    case tiller_status_sensor_out_of_range: return range_text(s);
    case tiller_status_sensor_jump: return jump_text(s);
    case tiller_status_sensor_frozen: return frozen_text(s);
    case tiller_status_time_backwards: return backwards_text(s);
    case tiller_status_contact: return contact_text(s);
    case tiller_status_deadline_missed:
    case tiller_status_iteration_capped: return deadline_text(s);
    case tiller_status_command_limited:
    case tiller_status_rate_limited: return command_text(s);
    default: return "";
  }
}

}  // namespace

void SensorMemory::take(const RecordEntry& entry, std::size_t index, std::size_t count) {
  const tiller_measurement_t& m = entry.record.measurement;
  value.resize(count, std::nan(""));
  stamp_us.resize(count, m.stamp_us);
  bool same = started;
  for (std::size_t k = 0; k < count; ++k) {
    same = same && std::memcmp(&value[k], &m.value[k], sizeof(double)) == 0;
    if (std::isnan(m.value[k])) continue;
    value[k] = m.value[k];
    stamp_us[k] = m.stamp_us;
  }
  repeats = same ? repeats + 1 : 0;
  started = true;
  last_us = m.stamp_us;
  last = index;
}

std::string place_text(const RecordedRun& run, std::size_t index) {
  const tiller_record_t& r = run.entries[index].record;
  const double time_s = seconds(r.now_us - run.entries[0].record.now_us);
  std::string text = format("%.2f s (tick %llu", time_s, static_cast<unsigned long long>(r.tick));
  if (run.first_line > 0) text += format(", line %zu", run.first_line + index);
  return text + ")";
}

std::string evidence_of(const RobotFile& robot, const tiller_config_t& config, const RecordedRun& run,
                        std::size_t index, tiller_status_t status, const SensorMemory& before) {
  return text_of(Scene{robot, config, run, index, before}, status);
}

}  // namespace tiller::tools
