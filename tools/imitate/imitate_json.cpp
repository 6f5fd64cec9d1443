#include <nlohmann/json.hpp>

#include "tools/base/json_number.hpp"
#include "tools/imitate/imitate.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::imitate {
namespace {

using nlohmann::json;

json row_json(const Matrix& m, Eigen::Index row) {
  json list = json::array();
  for (Eigen::Index k = 0; k < m.cols(); ++k) list.push_back(number(m(row, k)));
  return list;
}

json channels_json(const Matrix& m, const char* const* names) {
  json out = json::object();
  for (Eigen::Index i = 0; i < m.rows(); ++i) out[names[i]] = row_json(m, i);
  return out;
}

json motion_json(const Motion& motion, const tiller_model_t& model) {
  return {{"states", channels_json(motion.state, model.state_names)},
          {"inputs", channels_json(motion.input, model.input_names)}};
}

json measured_json(const Grid& grid, const tiller_model_t& model) {
  json out = json::object();
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    if (!grid.state[i].empty()) out[model.state_names[i]] = numbers(grid.state[i]);
  return out;
}

json weight_json(const LearntWeight& w) {
  return {{"key", w.term.key},          {"file", number(w.term.value)},
          {"value", number(w.value)},   {"interval_90", {number(w.low), number(w.high)}},
          {"log_sd", number(w.log_sd)}, {"varies", w.varies},
          {"identified", w.identified}};
}

json target_json(const LearntTarget& t) {
  return {{"key", t.target.key},
          {"file", number(t.target.value)},
          {"value", number(t.value)},
          {"interval_90", {number(t.low), number(t.high)}},
          {"identified", t.identified}};
}

json replayed_json(const Replayed& r, const tiller_model_t& model) {
  const Demonstration& d = *r.demonstration;
  return {{"path", d.path},
          {"first_time_s", number(d.first_time_s)},
          {"period_s", d.grid.period_s},
          {"misfit", number(d.misfit)},
          {"at_limits", number(d.limited)},
          {"measured", measured_json(d.grid, model)},
          {"demonstrated", motion_json(d.motion, model)},
          {"before", motion_json(r.before, model)},
          {"after", motion_json(r.after, model)},
          {"cost_demonstrated", number(r.cost_demonstrated)},
          {"cost_after", number(r.cost_after)},
          {"distance_before", number(r.rms_before)},
          {"distance_after", number(r.rms_after)}};
}

json policy_json(const ImitatedPolicy& policy) {
  const StoredNetwork& net = policy.stored.network;
  return {{"inputs", net.inputs},
          {"hidden", {net.hidden[0], net.hidden[1]}},
          {"weights", net.weights.size()},
          {"gap", numbers(policy.gap)}};
}

json units_json(const tiller_model_t& model) {
  json units = json::object();
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    units[model.state_names[i]] = unit_of_field(model.state_names[i]);
  for (std::uint32_t i = 0; i < model.input_count; ++i)
    units[model.input_names[i]] = unit_of_field(model.input_names[i]);
  return units;
}

}  // namespace

std::string imitate_json(const RobotFile& robot, const ImitateOptions& options, const Imitated& result) {
  json weights = json::array(), targets = json::array(), kept = json::array(), alike = json::array(),
       replayed = json::array();
  for (const LearntWeight& w : result.fit.weights) weights.push_back(weight_json(w));
  for (const LearntTarget& t : result.fit.targets) targets.push_back(target_json(t));
  for (const CostTerm& term : result.kept) kept.push_back({{"key", term.key}, {"value", number(term.value)}});
  for (const auto& [a, b] : result.fit.alike)
    alike.push_back({result.fit.weights[a].term.key, result.fit.weights[b].term.key});
  for (const Replayed& r : result.replayed) replayed.push_back(replayed_json(r, *robot.model));
  const json out = {{"robot", robot.name},
                    {"method", options.method},
                    {"horizon", result.horizon},
                    {"every", result.every},
                    {"inputs", result.fit.inputs},
                    {"inputs_at_limits", result.fit.limited},
                    {"nats", number(result.fit.nats)},
                    {"log_likelihood", number(result.fit.log_likelihood)},
                    {"log_likelihood_before", number(result.fit.before)},
                    {"converged", result.fit.converged},
                    {"kept", kept},
                    {"weights", weights},
                    {"targets", targets},
                    {"alike", alike},
                    {"units", units_json(*robot.model)},
                    {"demonstrations", replayed},
                    {"matching",
                     {{"excess", number(result.matching.excess)},
                      {"bound", number(result.matching.bound)},
                      {"demonstrated", numbers(result.matching.demonstrated)},
                      {"made", numbers(result.matching.made)}}},
                    {"policy", policy_json(result.policy)},
                    {"warnings", result.warnings}};
  return out.dump(1);
}

}  // namespace tiller::tools::imitate
