#include "tools/run_log.hpp"

#include <cmath>
#include <cstdio>

namespace tiller::tools {

RunLog::RunLog(const RobotFile& robot, bool has_true_state, std::vector<double> true_params)
    : robot_(robot), has_true_state_(has_true_state), true_params_(std::move(true_params)) {
  for (std::size_t i = 0; i < robot.params.size(); ++i) {
    if (robot.config.priors[i].kind != tiller_prior_fixed) inferred_.push_back(i);
  }
}

std::string RunLog::header() const {
  Words columns = {"time_s"};
  const auto add_all = [&](const char* prefix, const Words& names) {
    for (const std::string& name : names) columns.push_back(prefix + name);
  };
  Words inferred;
  for (const std::size_t i : inferred_) inferred.push_back(robot_.params[i]);
  add_all("", robot_.measurements);
  add_all("", robot_.inputs);
  add_all("mean.", robot_.states);
  add_all("sd.", robot_.states);
  for (const char* prefix : {"mean.", "sd.", "q05.", "q95."}) add_all(prefix, inferred);
  add_all("", {"ess", "noise_scale", "plan_cost", "iterations", "tick_us", "deadline_us", "adequacy_statistic", "state",
               "status"});
  if (has_true_state_) add_all("true.", robot_.states);
  if (!true_params_.empty()) add_all("true.", inferred);
  return join(columns, ",");
}

void RunLog::open(const std::string& path) {
  file_.open(path);
  file_.write(header() + "\n");
}

void RunLog::number(double value) {
  row_ += ',';
  if (!std::isfinite(value)) return;  // an empty field: every reader takes it for missing
  char text[32];
  row_.append(text, static_cast<std::size_t>(std::snprintf(text, sizeof text, "%.9g", value)));
}

void RunLog::add(const TickView& tick) {
  const tiller_info_t& info = *tick.info;
  char time[32];
  std::snprintf(time, sizeof time, "%.6f", tick.time_s);
  row_ = time;
  for (std::size_t i = 0; i < robot_.measurements.size(); ++i) {
    number(tick.measurement ? tick.measurement->value[i] : NAN);
  }
  for (std::size_t i = 0; i < robot_.inputs.size(); ++i) number(tick.command->value[i]);
  for (std::size_t i = 0; i < robot_.states.size(); ++i) number(info.state_mean[i]);
  for (std::size_t i = 0; i < robot_.states.size(); ++i) number(info.state_sd[i]);
  for (const std::size_t i : inferred_) number(info.param_mean[i]);
  for (const std::size_t i : inferred_) number(info.param_sd[i]);
  for (const std::size_t i : inferred_) number(tick.q05 ? tick.q05[i] : NAN);
  for (const std::size_t i : inferred_) number(tick.q95 ? tick.q95[i] : NAN);
  for (const double value : {info.effective_samples, info.noise_scale, info.plan_cost}) number(value);
  number(info.planner_iterations);
  number(tick.tick_us);
  number(robot_.config.planner.deadline_us);
  number(info.adequacy == tiller_adequacy_untested ? NAN : info.adequacy_statistic);
  row_ += ',';
  row_ += tiller_state_name(static_cast<tiller_state_t>(info.state));
  row_ += ',';
  row_ += tiller_status_name(tick.status);
  if (has_true_state_) {
    for (std::size_t i = 0; i < robot_.states.size(); ++i) number(tick.true_state ? tick.true_state[i] : NAN);
  }
  if (!true_params_.empty()) {
    for (const std::size_t i : inferred_) number(true_params_[i]);
  }
  row_ += '\n';
  file_.write(row_);
}

}  // namespace tiller::tools
