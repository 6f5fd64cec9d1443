// Measurements and commands as rows of a log.
#include "tools/logs/measured_rows.hpp"

#include <cmath>
#include <limits>

#include "tools/logs/log_columns.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// In floating point: stamps come from files, and their difference need not fit.
double seconds_between(std::int64_t from_us, std::int64_t to_us) {
  return 1e-6 * (static_cast<double>(to_us) - static_cast<double>(from_us));
}

}  // namespace

void MeasuredRows::begin(const RobotFile& robot, std::size_t expected) {
  begin_log("", LogMap(), *robot.config.model, log_);
  const tiller_config_t& config = robot.config;
  measured_.assign(config.measured_state, config.measured_state + config.measurement_count);
  log_.line.reserve(expected);
  log_.time_s.reserve(expected);
  for (const std::uint32_t state : measured_) log_.state[state].reserve(expected);
  for (auto& input : log_.input) input.reserve(expected);
}

void MeasuredRows::add(int line, std::int64_t stamp_us, const double* measured, const double* input) {
  if (log_.rows() == 0) first_us_ = stamp_us;
  last_us_ = stamp_us;
  log_.line.push_back(line);
  log_.time_s.push_back(seconds_between(first_us_, stamp_us));
  for (std::size_t k = 0; k < measured_.size(); ++k)
    log_.state[measured_[k]].push_back(std::isfinite(measured[k]) ? measured[k] : kNaN);
  for (std::size_t k = 0; k < log_.input.size(); ++k) log_.input[k].push_back(input ? input[k] : kNaN);
}

void MeasuredRows::set_input(std::size_t row, const double* input) {
  for (std::size_t k = 0; k < log_.input.size(); ++k) log_.input[k][row] = input[k];
}

void MeasuredRows::add(int line, const tiller_measurement_t& measurement, const tiller_command_t& command) {
  // before tiller moved the robot, a hand may have
  if (log_.rows() == 0 && command.state == tiller_state_standby) return;
  if (measurement.sequence == 0 && is_before_last(measurement.stamp_us)) return;
  add(line, measurement.stamp_us, measurement.value, command.value);
}

void MeasuredRows::note(const std::string& text) { add_note(text, log_); }

bool MeasuredRows::finish(const std::string& path, const char* what, const tiller_model_t& model, Log& log,
                          std::string& error) const {
  log = log_;
  log.path = path;
  LogWords words;
  words.row = "number ";
  words.rows = what;
  words.repeated = "two plants on one channel, or a log that was joined: record one run a file";
  words.backwards = "record one run a file";
  words.repetitions = "repeated measurements";
  LogProblems problems(log.path);
  const bool good = finish_log(words, model, log, problems);
  error = problems.text();
  return good;
}

}  // namespace tiller::tools
