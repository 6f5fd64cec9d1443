#include "tools/run/run_summary.hpp"

#include <cmath>

#include "tools/base/interval_text.hpp"
#include "tools/base/unit_names.hpp"
#include "tools/robot/prior_edge.hpp"
#include "tools/robot/units.hpp"
#include "tools/run/drift_text.hpp"
#include "tools/run/friction_text.hpp"

namespace tiller::tools {
namespace {

const char* feature_text(tiller_feature_t feature) {
  switch (feature) {
    case tiller_feature_bias: return "nothing: it is a constant";
    case tiller_feature_position: return "the position";
    case tiller_feature_velocity: return "the velocity";
    case tiller_feature_velocity_sign: return "the direction of motion";
    case tiller_feature_input: return "the input";
    case tiller_feature_input_change: return "the input's change";
    case tiller_feature_previous: return "what it left before";
    case tiller_feature_size: return "nothing, but it is larger than the noise";
    default: return "nothing";
  }
}

/// What a force that wanders did not take up, beside the usual causes; null: it is no force's.
const char* systematic_force(tiller_feature_t feature) {
  switch (feature) {
    case tiller_feature_bias: return "stays as it is (gravity or a sensor's offset that the model lacks)";
    case tiller_feature_position: return "goes with its position (a spring or gravity that the model lacks)";
    case tiller_feature_velocity: return "goes with its velocity (a friction or a drag that the model lacks)";
    case tiller_feature_velocity_sign: return "goes with its direction of motion (a dry friction that the model lacks)";
    case tiller_feature_input: return "goes with the input (a wrong gain of the drive, or a wrong parameter)";
    case tiller_feature_input_change:
      return "goes with the input's change (a delay, a lag or a wrong gain of the drive)";
    default: return nullptr;
  }
}

/// The joint whose position or velocity a measurement is; joint_count: none's.
std::uint32_t joint_of(const RobotFile& robot, std::uint32_t channel) {
  const std::uint32_t state = robot.config.measured_state[channel];
  std::uint32_t j = 0;
  while (j < robot.config.model->joint_count && robot.config.model->joints[j].position != state &&
         robot.config.model->joints[j].velocity != state)
    ++j;
  return j;
}

/// How large the friction is that the alarm is about, if it is one that the posterior estimates; else empty.
std::string followed_friction(const RobotFile& robot, const tiller_info_t& info) {
  const std::uint32_t joint = joint_of(robot, info.inadequate_channel);
  if (robot.config.posterior.disturbance == 0 || joint == robot.config.model->joint_count) return "";
  switch (info.inadequate_feature) {
    case tiller_feature_velocity: return viscous_text(robot, info, joint);
    case tiller_feature_velocity_sign: return dry_text(robot, info, joint);
    default: return "";
  }
}

/// Directions of which the data say next to nothing: those that keep more than half of the prior's deviation.
std::string not_learnt(const RobotFile& robot, const RunResult& result) {
  constexpr double kKept = 0.25;   // of the prior's variance
  constexpr double kNamed = 0.25;  // smaller entries of a direction are left out
  const std::size_t np = robot.names.params.size();
  std::string text;
  if (!robot.config.posterior.enabled) return text;
  for (std::size_t i = 0; i < result.contraction_ratio.size(); ++i) {
    if (result.contraction_ratio[i] < kKept) break;
    text += format("  not learnt: %.0f %% of the prior's deviation left along",
                   100 * std::sqrt(result.contraction_ratio[i]));
    for (std::size_t p = 0; p < np; ++p) {
      const double entry = result.contraction_direction[i * np + p];
      if (std::fabs(entry) < kNamed) continue;
      text += format(" %+.2f ", entry) + robot.names.params[p];
    }
    text += "\n";
  }
  return text;
}

/// What the data say of each parameter that may drift.
std::string drift_lines(const RobotFile& robot, const RunResult& result) {
  const Words units = parameter_units(robot.config, robot.names.params);
  const tiller_info_t& info = result.info;
  std::string text;
  std::size_t drift = 0;
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (((robot.config.posterior.drift >> i) & 1u) == 0) continue;
    const DriftFound found = {info.drift_evidence[drift], info.jump_evidence[drift], info.jump_age_s[drift],
                              info.jump_by[drift]};
    text += "  " + drift_text(robot.names.params[i], units[i] == "1" ? "" : units[i], found) + "\n";
    ++drift;
  }
  return text;
}

/// What changes the states beyond a model without joints.
std::string slip_line(const RobotFile& robot, const tiller_info_t& info) {
  std::string text;
  for (std::size_t i = 0; i < robot.names.states.size(); ++i) {
    if (((info.slip_states >> i) & 1u) == 0) continue;
    const std::string unit = unit_of_field(robot.names.states[i]);
    text += (text.empty() ? " " : ", ") + robot.names.states[i] +
            format(" %s +- %.2g ", mean_text(info.slip_mean[i], info.slip_sd[i]).c_str(), info.slip_sd[i]) +
            (unit.empty() ? "1" : unit) + "/s";
  }
  return text.empty() ? text : "  slips beyond the model:" + text + "\n";
}

std::string posterior_lines(const RobotFile& robot, const RunOptions& options, const RunResult& result) {
  std::string text;
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    const double mean = result.info.param_mean[i], sd = result.info.param_sd[i];
    const IntervalText ends = interval_ends(result.q05[i], result.q95[i]);
    text += format("  %-24s %s +- %.2g   90 %% in [%s, %s]", robot.names.params[i].c_str(), mean_text(mean, sd).c_str(),
                   sd, ends.low.c_str(), ends.high.c_str());
    if (i < options.files.true_params.size() && std::isfinite(options.files.true_params[i])) {
      text += "   true " + mean_text(options.files.true_params[i], sd);
    }
    text += "\n";
  }
  for (const std::string& edge : run_edges(robot, result)) text += "  " + edge + "\n";
  text += drift_lines(robot, result) + slip_line(robot, result.info);
  return text + not_learnt(robot, result);
}

std::string tick_line(const RobotFile& robot, const RunOptions& options, const RunResult& result) {
  const LatencyHistogram& took = result.pace.tick_time;
  std::string text =
      format("  tick %.2f ms median, %.2f ms 99 %%, %.2f ms max, of a period of %s ms", took.quantile_us(0.5) / 1000,
             took.quantile_us(0.99) / 1000, took.most_us() / 1000, number_text(1000 * robot.config.period_s).c_str());
  if (robot.config.planner.deadline_us > 0) {
    text += format("; %llu over the deadline of %.1f ms", static_cast<unsigned long long>(result.late_ticks),
                   robot.config.planner.deadline_us / 1000.0);
  }
  text += "\n";
  if (options.real_time || result.pace.overruns == 0) return text;
  return text + format("  %llu ticks took longer than the period: simulated time waits for them, a robot does not\n",
                       static_cast<unsigned long long>(result.pace.overruns));
}

std::string log_line(const LogState& log) {
  if (log.status == tiller_status_ok) return "";
  return "  logs: " + log_text(log) + "\n";
}

std::string pace_lines(const RobotFile& robot, const PaceResult& pace) {
  std::string text;
  if (pace.wake_up.count() > 0)
    text += format("  wake-up %.0f us late in the median, %.0f us 99 %%, %.0f us max; %llu periods skipped\n",
                   pace.wake_up.quantile_us(0.5), pace.wake_up.quantile_us(0.99), pace.wake_up.most_us(),
                   static_cast<unsigned long long>(pace.skipped_periods));
  text += format("  %llu ticks took longer than the period\n", static_cast<unsigned long long>(pace.overruns));
  const std::string realtime = realtime_text(robot, pace.realtime);
  return realtime.empty() ? text : text + "  " + realtime + "\n";
}

}  // namespace

const char* log_news(const LogState& log) {
  switch (log.status) {
    case tiller_status_ok: return "the logs are complete again";
    case tiller_status_queue_full: return "a disk does not keep up, ticks are missing in the logs; the run goes on";
    default: return "a disk takes no more of the logs, the rest is kept in memory; the run goes on";
  }
}

std::string log_text(const LogState& log) {
  if (log.status == tiller_status_ok) return "complete";
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  return format("%s: %llu ticks dropped, %llu bytes given up, %llu not written", tiller_status_name(log.status),
                count(log.dropped_ticks), count(log.lost_bytes), count(log.waiting_bytes));
}

std::string systematic_force_text(const RobotFile& robot, const tiller_info_t& info) {
  const std::uint32_t joint = joint_of(robot, info.inadequate_channel);
  const char* const force = systematic_force(static_cast<tiller_feature_t>(info.inadequate_feature));
  if (robot.config.posterior.disturbance == 0 || joint == robot.config.model->joint_count || !force) return "";
  const std::string amount = followed_friction(robot, info);
  return std::string("a force at joint '") + robot.config.model->joints[joint].name + "' " + force +
         (amount.empty() ? "" : ", " + amount);
}

std::string inadequacy(const RobotFile& robot, const tiller_info_t& info) {
  const auto feature = static_cast<tiller_feature_t>(info.inadequate_feature);
  const std::string what = "the model does not explain " + robot.names.measurements[info.inadequate_channel] + ": ";
  const std::string more = std::string(tiller_feature_name(feature)) + "; docs/theory/adequacy.md tells what to do)";
  const std::string force = systematic_force_text(robot, info);
  if (force.empty()) return what + "what it leaves goes with " + feature_text(feature) + " (" + more;
  const char* const beside = followed_friction(robot, info).empty() ? "beside the force that is estimated, " : "";
  return what + beside + force + "; tiller gap names it (" + more;
}

Words run_edges(const RobotFile& robot, const RunResult& result) {
  Words texts;
  if (!robot.config.posterior.enabled) return texts;
  const std::vector<PriorEdge> edges = find_prior_edges(robot.config, robot.names.params, result.particles);
  for (std::size_t i = 0; i < edges.size(); ++i)
    if (edges[i].side != EdgeSide::none) texts.push_back(edge_text(robot.names.params[i], edges[i]));
  return texts;
}

std::string probing_text(const tiller_info_t& info) {
  if (info.probed_ticks == 0) return "";
  return format("probed in %llu ticks, at %.3g of the %.3g that the budget allowed (docs/theory/probing.md)",
                static_cast<unsigned long long>(info.probed_ticks), info.probe_spent, info.probe_allowed);
}

std::string summary(const RobotFile& robot, const RunOptions& options, const RunResult& result) {
  std::string text = format(
      "%.2f s, %llu ticks, ended in %s%s\n", result.time_s, static_cast<unsigned long long>(result.ticks),
      tiller_state_name(static_cast<tiller_state_t>(result.info.state)), result.interrupted ? " (interrupted)" : "");
  text += posterior_lines(robot, options, result);
  for (const std::string& line : friction_lines(robot, result.info)) text += "  " + line + "; `tiller gap` names it\n";
  if (result.info.adequacy == tiller_adequacy_inadequate) text += "  " + inadequacy(robot, result.info) + "\n";
  if (result.info.relearned > 0)
    text += format("  the robot seemed to have changed: learnt again %llu times (docs/theory/posterior.md, relearn)\n",
                   static_cast<unsigned long long>(result.info.relearned));
  if (const std::string probing = probing_text(result.info); !probing.empty()) text += "  " + probing + "\n";
  text += tick_line(robot, options, result) + log_line(result.log);
  return options.real_time ? text + pace_lines(robot, result.pace) : text;
}

}  // namespace tiller::tools
