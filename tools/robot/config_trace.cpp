#include "tools/robot/config_trace.hpp"

#include <cstdlib>

#include "costs/cost_term_info.hpp"
#include "effects/effect_info.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

/// "a.b[3]" -> "a.b", 3; no index: 0.
std::string without_index(const std::string& field, std::size_t& index) {
  const std::size_t bracket = field.find('[');
  index = bracket == std::string::npos ? 0 : std::strtoul(field.c_str() + bracket + 1, nullptr, 10);
  return field.substr(0, bracket);
}

Words effect_path(std::size_t effect) { return {"effects", std::to_string(effect)}; }

Words prior_path(const RobotFile& robot, std::size_t param) {
  if (param < robot.config.model->param_count) return {"parameters", robot.names.params[param]};
  std::size_t first = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const EffectInfo& info = effect_info(robot.config.effects[e].kind);
    const std::size_t end = first + static_cast<std::size_t>(info.param_count);
    if (param < end) {
      Words path = effect_path(e);
      path.emplace_back(info.params[param - first].name);
      return path;
    }
    first = end;
  }
  return {"parameters"};
}

std::string name_at(const Words& names, std::size_t index) {
  return index < names.size() ? names[index] : std::to_string(index);
}

/// Of term i: its key, and the how many-th of its kind it is.
Words term_path(const RobotFile& robot, std::size_t i) {
  const tiller_cost_term_t* const terms = robot.config.terms;
  std::size_t before = 0;
  for (std::size_t k = 0; k < i && i < TILLER_MAX_COST_TERMS; ++k) before += terms[k].kind == terms[i].kind;
  if (i >= TILLER_MAX_COST_TERMS || terms[i].kind >= tiller_cost_term_kind_count) return {"cost"};
  return {"cost", cost_term_key(terms[i].kind), std::to_string(before)};
}

}  // namespace

Words trace_field(const RobotFile& robot, const std::string& field) {
  std::size_t i = 0;
  const std::string name = without_index(field, i);
  if (name == "priors") return prior_path(robot, i);
  if (name.rfind("prior_mixture.", 0) == 0) return {"posterior", "prior_file"};
  if (name.rfind("network", 0) == 0) return {"network", "file"};
  if (name.rfind("policy", 0) == 0) return {"policy", "file"};
  if (name == "effects") return effect_path(i);
  if (name == "measurement_sd") return {"measurement", name_at(robot.names.measurements, i), "sd"};
  if (name == "measured_state") return {"measurement", name_at(robot.names.measurements, i)};
  const std::string input = name_at(robot.names.inputs, i);
  if (name == "cost.terms") return term_path(robot, i);
  if (name == "safety.cones") return {"safety", "cones", std::to_string(i)};
  if (name == "cost.state_low") return {"cost", "bounds", name_at(robot.names.states, i), "low"};
  if (name == "cost.state_high") return {"cost", "bounds", name_at(robot.names.states, i), "high"};
  if (name == "cost.bound_weight") return {"cost", "bounds", name_at(robot.names.states, i), "weight"};
  if (name == "cost.outputs") return {"cost", "outputs", name_at(robot.names.outputs, i)};
  if (name.rfind("cost.own.", 0) == 0) return {"model", "file"};
  if (name == "safety.input_low") return {"limits", input, "low"};
  if (name == "safety.input_high") return {"limits", input, "high"};
  if (name == "safety.input_rate_per_s") return {"limits", input, "rate_per_s"};
  if (name == "safety.safe_command") return {"limits", input, "safe"};
  if (name == "probe.until_sd") return {"probe", "until_sd", name_at(robot.names.params, i)};
  const std::string sensor = name_at(robot.names.measurements, i);
  if (name == "safety.measurement_low") return {"measurement", sensor, "low"};
  if (name == "safety.measurement_high") return {"measurement", sensor, "high"};
  if (name == "safety.measurement_rate_per_s") return {"measurement", sensor, "rate_per_s"};
  for (const KeySpec& key : robot_keys()) {
    if (!key.field || name != key.field) continue;
    if (key.kind == KeyKind::state_numbers) return {key.section, key.key, name_at(robot.names.states, i)};
    if (key.kind == KeyKind::input_numbers) return {key.section, key.key, input};
    return {key.section, key.key};
  }
  const std::size_t dot = name.find('.');
  if (dot == std::string::npos) return {"model", name};
  return {name.substr(0, dot), name.substr(dot + 1)};
}

}  // namespace tiller::tools
