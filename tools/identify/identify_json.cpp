#include <cmath>
#include <nlohmann/json.hpp>

#include "tools/base/json_number.hpp"
#include "tools/identify/identify.hpp"
#include "tools/robot/prior_json.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

json log_json(const LogFacts& log) {
  return {{"path", log.path},
          {"rows", log.rows},
          {"length_s", number(log.length_s)},
          {"step_s", number(log.step_s)},
          {"stretches", log.stretches}};
}

json used_json(const UsedRows& used) {
  return {{"all_s", number(used.all_s)},
          {"used_s", number(used.used_s)},
          {"pieces", used.pieces},
          {"piece_s", number(used.piece_s)},
          {"text", used.text()}};
}

/// The prior as the robot file states it. Of a uniform one, a and b mean nothing; bounds that are not there are null.
json stated_prior_json(const tiller_prior_t& prior) {
  return {{"kind", prior_kind_name(prior.kind)},
          {"a", number(prior.a)},
          {"b", number(prior.b)},
          {"low", number(prior.low)},
          {"high", number(prior.high)}};
}

json param_json(const ParamSummary& p, const std::string& unit, const tiller_prior_t& prior) {
  json out = {{"name", p.name}, {"unit", unit}, {"fixed", p.fixed}, {"mean", number(p.mean)}};
  if (p.fixed) return out;
  out["sd"] = number(p.sd);
  out["interval_90"] = {number(p.low), number(p.high)};
  out["median"] = number(p.median);
  out["edge"] = edge_json(p.name, p.edge);
  out["prior"] = {{"mean", number(p.prior_mean)},
                  {"sd", number(p.prior_sd)},
                  {"interval_90", {number(p.prior_low), number(p.prior_high)}},
                  {"stated", stated_prior_json(prior)}};
  return out;
}

json score_json(const Score& score, const RobotFile& robot) {
  json list = json::array();
  for (const StateScore& state : score.states) {
    json horizons = json::array();
    for (const HorizonError& e : state.horizons)
      horizons.push_back({{"horizon_s", e.horizon_s},
                          {"rollouts", e.rollouts},
                          {"rms_end", number(e.rms_end)},
                          {"median_abs_end", number(e.median_end)},
                          {"rms_along", number(e.rms_along)},
                          {"coverage_90", number(e.coverage_90)}});
    list.push_back({{"state", robot.config.model->state_names[state.state]},
                    {"unit", unit_of_field(robot.config.model->state_names[state.state])},
                    {"horizons", horizons},
                    {"rms_by_step", numbers(state.curve)}});
  }
  return list;
}

json traces_json(const Score& score, const RobotFile& robot) {
  json list = json::array();
  for (const RolloutTrace& trace : score.traces)
    list.push_back({{"path", trace.path},
                    {"state", robot.config.model->state_names[trace.state]},
                    {"unit", unit_of_field(robot.config.model->state_names[trace.state])},
                    {"start_s", number(trace.start_s)},
                    {"period_s", trace.period_s},
                    {"measured", numbers(trace.measured)},
                    {"mean", numbers(trace.mean)},
                    {"low", numbers(trace.low)},
                    {"high", numbers(trace.high)},
                    {"predictive_low", numbers(trace.predictive_low)},
                    {"predictive_high", numbers(trace.predictive_high)}});
  return list;
}

// Draws of the parameters that were learnt: (draws x learnt), for marginals and pairs.
json samples_json(const Fit& fit, const std::vector<double>& samples) {
  const std::size_t np = fit.params.size();
  json rows = json::array();
  for (std::size_t s = 0; s * np < samples.size(); ++s) {
    json row = json::array();
    for (std::size_t i = 0; i < np; ++i)
      if (!fit.params[i].fixed) row.push_back(number(samples[s * np + i]));
    if (!row.empty()) rows.push_back(row);
  }
  return rows;
}

template <class Value>
json series(const std::vector<Snapshot>& snapshots, Value value) {
  json list = json::array();
  for (const Snapshot& s : snapshots) list.push_back(number(value(s)));
  return list;
}

// The posterior while the logs were taken in: arrays over the snapshots.
json history_json(const Fit& fit, const RobotFile& robot) {
  const std::vector<Snapshot>& all = fit.history.snapshots();
  json params = json::array();
  for (std::size_t i = 0; i < fit.params.size(); ++i) {
    if (fit.params[i].fixed) continue;
    params.push_back({{"name", fit.params[i].name},
                      {"mean", series(all, [i](const Snapshot& s) { return s.mean[i]; })},
                      {"low", series(all, [i](const Snapshot& s) { return s.low[i]; })},
                      {"high", series(all, [i](const Snapshot& s) { return s.high[i]; })}});
  }
  json residuals = json::array();
  for (std::uint32_t k = 0; k < robot.config.measurement_count && !all.empty(); ++k)
    residuals.push_back({{"name", robot.config.model->state_names[robot.config.measured_state[k]]},
                         {"low", series(all, [k](const Snapshot& s) { return s.residual_low[k]; })},
                         {"high", series(all, [k](const Snapshot& s) { return s.residual_high[k]; })},
                         {"rms", series(all, [k](const Snapshot& s) { return s.residual_rms[k]; })}});
  return {{"data_s", series(all, [](const Snapshot& s) { return s.data_s; })},
          {"stretches_s", numbers(fit.history.stretches_s())},
          {"parameters", params},
          {"effective_samples", series(all, [](const Snapshot& s) { return s.effective_samples; })},
          {"noise_scale", series(all, [](const Snapshot& s) { return s.noise_scale; })},
          {"exponent", series(all, [](const Snapshot& s) { return s.exponent; })},
          {"adequacy", series(all, [](const Snapshot& s) { return s.adequacy_statistic; })},
          {"residuals", residuals},
          {"acceptance", series(all, [](const Snapshot& s) { return s.acceptance; })}};
}

// By what it was learnt, and how that went; of the posterior the history tells more.
json method_json(const Fit& fit) {
  const Method& method = *find_method(fit.method);
  json iterations = json::array();
  for (const MethodIteration& i : fit.iterations)
    iterations.push_back({{"mean", numbers(i.mean)},
                          {"sd", numbers(i.sd)},
                          {"temperature", number(i.temperature)},
                          {"kl", number(i.kl)},
                          {"effective_samples", number(i.effective_samples)},
                          {"discrepancy", number(i.discrepancy)},
                          {"smallest_discrepancy", number(i.best)}});
  return {{"name", method.name},      {"citation", method.citation},
          {"caveat", method.caveat},  {"simulations", fit.simulations},
          {"diverged", fit.diverged}, {"iterations", iterations}};
}

// null: tested, and nothing found.
json alarm_json(const Fit& fit, const RobotFile& robot) {
  const Alarm& alarm = fit.history.alarm();
  if (!alarm.raised) return nullptr;
  return {{"data_s", number(alarm.data_s)},
          {"channel", robot.config.model->state_names[robot.config.measured_state[alarm.channel]]},
          {"feature", tiller_feature_name(alarm.feature)}};
}

// What the residuals of each measurement go with, in deviations.
json trends_json(const Fit& fit, const RobotFile& robot) {
  json list = json::array();
  for (std::size_t k = 0; k < fit.trends.size(); ++k) {
    const ResidualTrend& trend = fit.trends[k];
    json inputs = json::object();
    for (std::size_t j = 0; j < trend.inputs.size(); ++j)
      inputs[robot.config.model->input_names[j]] = number(trend.inputs[j]);
    list.push_back({{"name", robot.config.model->state_names[robot.config.measured_state[k]]},
                    {"value", number(trend.value)},
                    {"change", number(trend.change)},
                    {"inputs", inputs}});
  }
  return list;
}

json candidate_json(const Assessed& assessed, const RobotFile& robot) {
  const Fit& fit = assessed.fit;
  json params = json::array();
  const Words units = parameter_units(assessed.candidate.config, assessed.candidate.params);
  for (std::size_t i = 0; i < fit.params.size(); ++i)
    params.push_back(param_json(fit.params[i], units[i], assessed.candidate.config.priors[i]));
  const bool held_out = !assessed.on_held_out.states.empty();
  json out = {{"name", assessed.candidate.name},
              {"learns", assessed.candidate.learns()},
              {"parameters", params},
              {"method", method_json(fit)},
              {"noise_scale", number(fit.noise_scale)},
              {"rollout_sigma", number(assessed.rollout_sigma)},
              {"adequate", assessed.adequate()},
              {"process_scale", number(fit.process_scale)},
              {"particles", fit.particles},
              {"effective_samples", number(fit.effective_samples)},
              {"exponent", number(fit.exponent)},
              {"transitions", fit.transitions},
              {"refused", fit.refused},
              {"gated", fit.gated},
              {"diverged", assessed.on_held_out.diverged + assessed.on_fitted.diverged},
              {"fitted", score_json(assessed.on_fitted, robot)},
              {"held_out", score_json(assessed.on_held_out, robot)},
              {"samples", samples_json(fit, fit.samples)},
              {"prior_samples", samples_json(fit, fit.prior_samples)},
              {"history", history_json(fit, robot)},
              {"traces", traces_json(held_out ? assessed.on_held_out : assessed.on_fitted, robot)}};
  if (fit.tested) {
    out["alarm"] = alarm_json(fit, robot);
    out["residual_trends"] = trends_json(fit, robot);
  }
  return out;
}

}  // namespace

std::string identify_json(const RobotFile& robot, const Identified& result) {
  json out = {{"tiller", tiller_version()},
              {"robot", robot.name},
              {"robot_file", robot.path},
              {"model", robot.config.model->name},
              {"period_s", robot.config.period_s},
              {"warnings", result.warnings},
              {"logs", json::array()},
              {"held_out", json::array()},
              {"candidates", json::array()}};
  out["used"] = used_json(result.used);
  if (!result.hold_out.empty()) out["used_held_out"] = used_json(result.used_held_out);
  for (const LogFacts& log : result.logs) out["logs"].push_back(log_json(log));
  for (const LogFacts& log : result.hold_out) out["held_out"].push_back(log_json(log));
  for (const Assessed& assessed : result.candidates) out["candidates"].push_back(candidate_json(assessed, robot));
  return out.dump(1) + "\n";
}

}  // namespace tiller::tools
