#include "tools/logs/alarm_window.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace tiller::tools {
namespace {

/// The guard refused it: neither the controller nor a fit learns from it.
bool refused(std::int32_t status) {
  return status >= tiller_status_sensor_stale && status <= tiller_status_time_backwards;
}

}  // namespace

std::uint32_t AlarmWindow::ring_ticks(const RobotFile& robot, double seconds) {
  constexpr double kMost = 65536;  // as the robot file's recorder.ticks
  return static_cast<std::uint32_t>(std::min(kMost, std::ceil(seconds / robot.config.period_s)));
}

void AlarmWindow::begin(const std::string& path, double seconds) {
  wanted_s_ = seconds;
  file_.open(path);
  Words columns = {"time_s"};
  columns.insert(columns.end(), robot_.names.measurements.begin(), robot_.names.measurements.end());
  columns.insert(columns.end(), robot_.names.inputs.begin(), robot_.names.inputs.end());
  file_.write(join(columns, ",") + "\n");
  open_ = true;
}

void AlarmWindow::add(const tiller_record_t& record) {
  if (!open_) return;
  if (record.command.state == tiller_state_safe) {
    (void)close();
    return;
  }
  const tiller_measurement_t& m = record.measurement;
  const bool taken = record.has_measurement != 0 && !refused(record.status) && (!pending_ || m.stamp_us > last_us_);
  Command command;
  const std::int64_t told_us = taken ? m.stamp_us + std::int64_t{m.command_latency_us} : record.now_us;
  command.from_us = std::max(record.now_us, told_us);
  std::copy(record.command.value, record.command.value + TILLER_MAX_INPUTS, command.value);
  if (taken) {
    if (pending_) write_row(m.stamp_us);
    pending_ = true;
    measurement_ = m;
    last_us_ = m.stamp_us;
    if (rows_ == 0) first_us_ = m.stamp_us;
  }
  // a later command overrules what has not taken hold yet
  while (!commands_.empty() && commands_.back().from_us >= command.from_us) commands_.pop_back();
  commands_.push_back(command);
  while (commands_.size() > 1 && commands_[1].from_us <= last_us_) commands_.pop_front();
  if (seconds() >= wanted_s_) (void)close();
}

/// Time-weighted; before the first command that is known, that one.
void AlarmWindow::mean_input(std::int64_t begin_us, std::int64_t end_us, double* mean) const {
  const std::size_t nu = robot_.names.inputs.size();
  std::fill(mean, mean + nu, 0.0);
  for (std::size_t k = 0; k < commands_.size(); ++k) {
    const std::int64_t from = k == 0 ? begin_us : std::max(begin_us, commands_[k].from_us);
    const std::int64_t until = k + 1 == commands_.size() ? end_us : std::min(end_us, commands_[k + 1].from_us);
    if (until <= from) continue;
    const double share = static_cast<double>(until - from) / static_cast<double>(end_us - begin_us);
    for (std::size_t i = 0; i < nu; ++i) mean[i] += share * commands_[k].value[i];
  }
}

void AlarmWindow::write_row(std::int64_t end_us) {
  double mean[TILLER_MAX_INPUTS];
  mean_input(measurement_.stamp_us, end_us, mean);
  char text[32];
  std::string row(text, static_cast<std::size_t>(std::snprintf(
                            text, sizeof text, "%.6f", 1e-6 * static_cast<double>(measurement_.stamp_us - first_us_))));
  const auto number = [&](double value) {
    row += ',';
    if (!std::isfinite(value)) return;  // an empty field is a missing value
    row.append(text, static_cast<std::size_t>(std::snprintf(text, sizeof text, "%.10g", value)));
  };
  for (std::size_t i = 0; i < robot_.names.measurements.size(); ++i) number(measurement_.value[i]);
  for (std::size_t i = 0; i < robot_.names.inputs.size(); ++i) number(mean[i]);
  file_.write(row + "\n");
  ++rows_;
}

bool AlarmWindow::close() {
  if (!open_) return file_.complete();
  open_ = false;
  return file_.close();
}

}  // namespace tiller::tools
