// A recorded run of any format, told by its first bytes.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "tools/base/csv_reader.hpp"
#include "tools/base/whole_file.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/logs/mcap_run.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/logs/run_log.hpp"

namespace tiller::tools {
namespace {

/// A CSV of `tiller run --log` tells of each tick its number and the time.
bool is_csv_run(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  CsvReader csv(file);
  if (!csv.read_header()) return false;
  const auto has = [&](const char* name) { return index_of(csv.names(), name) >= 0; };
  return has("time_s") && has("tick") && has("now_us");
}

bool read_record(const std::string& path, RecordedRun& run, std::string& error) {
  run.has_config = true;
  if (!read_record_file(path, run.config, run.joint, run.entries, error)) return false;
  const std::uintmax_t ticks_bytes = std::filesystem::file_size(path) - record_header(run.config).size();
  run.cut_off = ticks_bytes % sizeof(RecordEntry) != 0;
  if (run.cut_off) run.note = format("%zu whole ticks; the one behind them is cut off", run.entries.size());
  return true;
}

/// The input that was in force at the end of a row: the command that answers its measurement.
double answer_to(const Log& log, std::size_t input, std::size_t row) {
  const std::vector<double>& times = log.input_times();
  const bool last = row + 1 == log.rows();
  const auto next = last ? times.end() : std::lower_bound(times.begin(), times.end(), log.time_s[row + 1]);
  return log.input[input][static_cast<std::size_t>(std::max<std::ptrdiff_t>(next - times.begin() - 1, 0))];
}

/// Rows of a log from elsewhere as ticks, one a period: its measurements go in, and its inputs are what came out.
bool read_measured(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error) {
  Log log;
  if (!read_any_log(path, robot, log, error)) {
    error += "\n";
    return false;
  }
  constexpr std::int64_t kStart_us = 1000000;  // a controller's clock is above zero
  const double half_step_s = 0.5 * std::min(median_step_s(log), robot.config.period_s);
  double next_s = 0;
  for (std::size_t row = 0; row < log.rows(); ++row) {
    if (log.time_s[row] + half_step_s < next_s) continue;
    next_s = log.time_s[row] + robot.config.period_s;
    RecordEntry entry;
    tiller_record_t& r = entry.record;
    r.tick = run.entries.size();
    r.now_us = r.command.stamp_us = r.measurement.stamp_us = kStart_us + std::llround(1e6 * log.time_s[row]);
    r.calls = r.tick == 0 ? tiller_call_arm : tiller_call_prepare;
    r.has_measurement = 1;
    r.measurement.sequence = r.command.sequence = static_cast<std::uint32_t>(r.tick + 1);
    for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k) {
      const std::vector<double>& values = log.state[robot.config.measured_state[k]];
      r.measurement.value[k] = values.empty() ? std::nan("") : values[row];
    }
    for (std::uint32_t i = 0; i < robot.config.model->input_count; ++i) r.command.value[i] = answer_to(log, i, row);
    r.command.state = kStateUnknown;
    r.planner_iterations = kIterationsUnknown;
    r.state_mean[0] = std::nan("");
    run.entries.push_back(entry);
  }
  run.note =
      "a log from elsewhere: its rows are the ticks, one a period; it tells neither states nor iterations of a "
      "controller, so that commands alone are compared: give a --tolerance";
  if (!log.note.empty()) run.note += "; " + log.note;
  return true;
}

/// A log of the robot's may be older than its posterior's forces, or than the logs' having them.
void note_missing_forces(const RobotFile& robot, RecordedRun& run) {
  const auto tells = [](const RecordEntry& entry) { return entry.force_joints > 0; };
  if (felt_forces(robot.config).empty() || std::any_of(run.entries.begin(), run.entries.end(), tells)) return;
  run.note += (run.note.empty() ? "" : "; ") + std::string("the forces beyond the model are not in it");
}

}  // namespace

bool read_recorded_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error) {
  const std::string kind = log_format(path);
  run = {};
  if (kind == "lcm") {  // it finds holes itself
    const bool read_lcm = read_lcm_run(path, robot, run, error);
    note_missing_forces(robot, run);
    return read_lcm;
  }
  bool read = false, ours = true;
  std::ifstream file(path, std::ios::binary);
  std::string mcap;
  if (kind == "mcap" && !read_whole_file(path, mcap, error)) {
    error += "\n";
    return false;
  }
  if (kind == "record")
    read = read_record(path, run, error);
  else if (is_mcap_run(mcap))
    read = read_mcap_run(mcap, path, robot, run, error);
  else if (kind == "csv" && is_csv_run(path))
    read = read_csv_run(file, path, robot, run, error);
  else
    ours = false, read = read_measured(path, robot, run, error);
  if (!read && kind == "csv" && file && !is_csv_run(path))
    error += path + ": is no record of tiller either; `tiller run --record FILE` writes one\n";
  find_holes(run);
  if (ours) note_missing_forces(robot, run);
  return read;
}

std::string robot_in_log(const std::string& path, std::string& error) {
  std::string bytes;
  return log_format(path) == "mcap" && read_whole_file(path, bytes, error) ? robot_text_of(bytes) : "";
}

}  // namespace tiller::tools
