#include "tools/logs/measured_rows.hpp"

#include <cstring>

#include "tools/base/text.hpp"
#include "tools/robot/attitude_signs.hpp"

namespace tiller::tools {
namespace {

// In floating point: stamps come from files, and their difference need not fit.
double seconds_between(std::int64_t from_us, std::int64_t to_us) {
  return 1e-6 * (static_cast<double>(to_us) - static_cast<double>(from_us));
}

std::string stamp_problem(const MeasuredRow& before, const MeasuredRow& row) {
  if (row.stamp_us == before.stamp_us)
    return "the stamp repeats that of number " + std::to_string(before.line) +
           "; two plants on one channel, or a log that was joined: record one run a file";
  return "time goes backwards by " + format("%.6g", seconds_between(row.stamp_us, before.stamp_us)) +
         " s; record one run a file";
}

void add_row(const MeasuredRow& row, std::int64_t start_us, const RobotFile& robot, Log& log) {
  log.line.push_back(row.line);
  log.time_s.push_back(seconds_between(start_us, row.stamp_us));
  for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k)
    log.state[robot.config.measured_state[k]].push_back(row.measured[k]);
  for (std::uint32_t k = 0; k < robot.model->input_count; ++k) log.input[k].push_back(row.input[k]);
}

}  // namespace

void add_measured_row(int line, const tiller_measurement_t& measurement, const tiller_command_t& command,
                      std::vector<MeasuredRow>& rows) {
  if (!rows.empty() && measurement.sequence == 0 && measurement.stamp_us < rows.back().stamp_us) return;
  MeasuredRow row;
  row.line = line;
  row.stamp_us = measurement.stamp_us;
  std::memcpy(row.measured, measurement.value, sizeof row.measured);
  std::memcpy(row.input, command.value, sizeof row.input);
  rows.push_back(row);
}

bool make_log(const std::vector<MeasuredRow>& rows, const std::string& path, const char* what, const RobotFile& robot,
              Log& log, std::string& error) {
  log = {};
  log.path = path;
  log.state.resize(robot.model->state_count);
  log.input.resize(robot.model->input_count);
  const auto fail = [&](int line, const std::string& text) {
    error += (error.empty() ? "" : "\n") + path + ":" + std::to_string(line) + ": " + text;
  };
  if (rows.size() < 20) fail(1, std::to_string(rows.size()) + " " + what + " are too few to learn from; at least 20");
  int wrong = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i > 0 && rows[i].stamp_us <= rows[i - 1].stamp_us && ++wrong <= 3)
      fail(rows[i].line, stamp_problem(rows[i - 1], rows[i]));
    add_row(rows[i], rows[0].stamp_us, robot, log);
  }
  take_near_signs(robot.model->quaternion_mask, log.state);
  return error.empty();
}

}  // namespace tiller::tools
