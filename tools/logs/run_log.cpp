#include "tools/logs/run_log.hpp"

#include <charconv>
#include <cmath>

#include "posterior/posterior.hpp"
#include "tools/robot/stage_cost.hpp"

namespace tiller::tools {

RunLog::RunLog(const RobotFile& robot, bool has_true_state, std::vector<double> true_params, std::uint32_t goals)
    : robot_(robot),
      has_true_state_(has_true_state),
      goals_(goals),
      true_params_(std::move(true_params)),
      frames_(robot.config) {
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (robot.config.priors[i].kind != tiller_prior_fixed) inferred_.push_back(i);
  }
}

Words felt_forces(const tiller_config_t& config) {
  Words names;
  for (std::uint32_t j = 0; j < Posterior::force_joints(config); ++j)
    names.emplace_back(config.model->force_names[config.model->joints[j].force]);
  return names;
}

std::string RunLog::header() const {
  Words columns = {"time_s"};
  const auto add_all = [&](const char* prefix, const Words& names) {
    for (const std::string& name : names) columns.push_back(prefix + name);
  };
  Words inferred;
  for (const std::size_t i : inferred_) inferred.push_back(robot_.names.params[i]);
  add_all("", robot_.names.measurements);
  add_all("", robot_.names.inputs);
  add_all("mean.", robot_.names.states);
  add_all("sd.", robot_.names.states);
  for (const char* prefix : {"mean.", "sd.", "q05.", "q95."}) add_all(prefix, inferred);
  add_all("", {"ess", "noise_scale", "plan_cost", "iterations", "tick_us", "deadline_us", "adequacy_statistic", "state",
               "status"});
  if (has_true_state_) add_all("true.", robot_.names.states);
  if (!true_params_.empty()) add_all("true.", inferred);
  if (robot_.config.cost.reference) add_all("ref.", robot_.names.states);
  if (robot_.config.cost.outputs) add_all("out.", robot_.names.outputs);
  if (robot_.config.planner.predict_spread != 0)
    for (const char* prefix : {"foreseen.mean.", "foreseen.sd."}) add_all(prefix, robot_.names.states);
  if (robot_.config.posterior.adequacy != 0) add_all("innovation.", robot_.names.measurements);
  const Words forces = felt_forces(robot_.config);
  for (const char* prefix : {"force.mean.", "force.sd."}) add_all(prefix, forces);
  if (!forces.empty()) columns.emplace_back("touched");
  for (const char* prefix : {"force.mean.", "force.sd."}) add_all(prefix, frames_.names());
  if (robot_.config.probe.weight > 0.0)
    add_all("", {"probing", "calibration_left", "probe_value", "probe_cost", "probe_spent", "probe_allowed",
                 "probe_information"});
  if (goals_ != 0) columns.emplace_back("goal");
  if ((goals_ & kGoalStates) != 0) add_all("goal.", robot_.names.states);
  if ((goals_ & kGoalOutputs) != 0) add_all("goal.", robot_.names.outputs);
  add_all("", {"tick", "now_us", "stamp_us", "sequence", "command_latency_us", "infinite", "calls", "stop_status"});
  return join(columns, ",");
}

void RunLog::open(const std::string& path) {
  file_.open(path);
  file_.write(header() + "\n");
}

void RunLog::cell(const std::string& text) {
  row_ += ',';
  row_ += text;
}

// What is not finite becomes an empty field: every reader takes it for missing.
void RunLog::number(double value) { cell(std::isfinite(value) ? format("%.9g", value) : ""); }

/// The shortest text that reads back as the same double.
void RunLog::exact(double value) {
  char text[32];
  const char* end = std::isfinite(value) ? std::to_chars(text, text + sizeof text, value).ptr : text;
  cell(std::string(text, static_cast<std::size_t>(end - text)));
}

void RunLog::reference(const tiller_info_t& info) {
  const tiller_cost_config_t& cost = robot_.config.cost;
  if (!cost.reference) return;
  const auto step = task_.step(info.ticks - 1, static_cast<tiller_state_t>(info.state));
  for (std::size_t i = 0; i < robot_.names.states.size(); ++i)
    number(step ? reference_row(cost, robot_.names.states.size(), *step)[i] : NAN);
}

/// At the joints and at the frames.
void RunLog::forces(const tiller_info_t& info) {
  const std::uint32_t joints = Posterior::force_joints(robot_.config);
  for (const double* row : {info.force_mean, info.force_sd})
    for (std::uint32_t j = 0; j < joints; ++j) exact(row[j]);
  if (joints > 0) cell(std::to_string(info.touched));
  double mean[TILLER_MAX_OUTPUTS], sd[TILLER_MAX_OUTPUTS];
  frames_.compute(info, mean, sd);
  for (const double* row : {mean, sd})
    for (std::size_t i = 0; i < frames_.names().size(); ++i) number(row[i]);
}

/// Outputs, what was foreseen, innovations, forces, and goals.
void RunLog::task(const LoggedTick& tick) {
  for (std::size_t j = 0; robot_.config.cost.outputs && j < robot_.names.outputs.size(); ++j) number(tick.outputs[j]);
  if (robot_.config.planner.predict_spread != 0)
    for (const double* row : {tick.foreseen_mean, tick.foreseen_sd})
      for (std::size_t i = 0; i < robot_.names.states.size(); ++i) number(tick.was_foreseen ? row[i] : NAN);
  for (std::size_t i = 0; robot_.config.posterior.adequacy != 0 && i < robot_.names.measurements.size(); ++i)
    number(tick.innovation[i]);
  forces(tick.info);
  if (robot_.config.probe.weight > 0.0) {
    const tiller_info_t& info = tick.info;
    cell(std::to_string(info.probing));
    cell(std::to_string(info.calibration_left));
    for (const double value :
         {info.probe_value, info.probe_cost, info.probe_spent, info.probe_allowed, info.probe_information})
      exact(value);
  }
  if (goals_ != 0) cell(std::to_string(tick.entry.goal));
  for (std::size_t i = 0; (goals_ & kGoalStates) != 0 && i < robot_.names.states.size(); ++i)
    exact(tick.entry.target[i]);
  for (std::size_t j = 0; (goals_ & kGoalOutputs) != 0 && j < robot_.names.outputs.size(); ++j)
    exact(tick.entry.output_target[j]);
}

void RunLog::replayed(const LoggedTick& tick) {
  const tiller_record_t& record = tick.entry.record;
  const tiller_measurement_t* m = record.has_measurement != 0 ? &record.measurement : nullptr;
  const auto only_measured = [&](std::int64_t value) { cell(m ? std::to_string(value) : ""); };
  std::uint32_t infinite = 0;
  for (std::size_t i = 0; m && i < robot_.names.measurements.size(); ++i)
    if (std::isinf(m->value[i])) infinite |= (m->value[i] < 0 ? 0x10001u : 1u) << i;
  cell(std::to_string(record.tick));
  cell(std::to_string(record.now_us));
  only_measured(m ? m->stamp_us : 0);
  only_measured(m ? m->sequence : 0);
  only_measured(m ? m->command_latency_us : 0);
  only_measured(infinite);
  cell(std::to_string(record.calls));
  cell(std::to_string(tick.entry.stop_status));
}

void RunLog::add(const LoggedTick& tick) {
  const tiller_info_t& info = tick.info;
  const tiller_record_t& record = tick.entry.record;
  row_ = format("%.6f", tick.time_s);
  for (std::size_t i = 0; i < robot_.names.measurements.size(); ++i) {
    exact(record.has_measurement != 0 ? record.measurement.value[i] : NAN);
  }
  for (std::size_t i = 0; i < robot_.names.inputs.size(); ++i) exact(record.command.value[i]);
  for (std::size_t i = 0; i < robot_.names.states.size(); ++i) exact(info.state_mean[i]);
  for (std::size_t i = 0; i < robot_.names.states.size(); ++i) number(info.state_sd[i]);
  for (const std::size_t i : inferred_) exact(info.param_mean[i]);
  for (const std::size_t i : inferred_) exact(info.param_sd[i]);
  for (const std::size_t i : inferred_) number(tick.q05[i]);
  for (const std::size_t i : inferred_) number(tick.q95[i]);
  for (const double value : {info.effective_samples, info.noise_scale, info.plan_cost}) number(value);
  number(info.planner_iterations);
  number(tick.tick_us);
  number(robot_.config.planner.deadline_us);
  number(info.adequacy == tiller_adequacy_untested ? NAN : info.adequacy_statistic);
  cell(tiller_state_name(static_cast<tiller_state_t>(info.state)));
  cell(tiller_status_name(tick.status));
  if (has_true_state_) {
    for (std::size_t i = 0; i < robot_.names.states.size(); ++i) number(tick.has_truth ? tick.true_state[i] : NAN);
  }
  if (!true_params_.empty()) {
    for (const std::size_t i : inferred_) number(true_params_[i]);
  }
  reference(info);
  task(tick);
  replayed(tick);
  row_ += '\n';
  file_.write(row_);
}

}  // namespace tiller::tools
