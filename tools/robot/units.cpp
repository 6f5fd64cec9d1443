#include "tools/robot/units.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {
namespace {

bool turns(PortKind kind, std::uint32_t port, const tiller_model_t& model) {
  const std::string name = kind == PortKind::joint   ? model.force_names[model.joints[port].force]
                           : kind == PortKind::input ? model.input_names[port]
                                                     : model.state_names[port];
  return name.find("Nm") != std::string::npos || name.find("rad") != std::string::npos;
}

}  // namespace

std::string unit_of_effect(const EffectInfo& info, int param, std::uint32_t port, const tiller_model_t& model) {
  std::string unit = info.params[param].unit;
  port = first_port(info, port, model);
  if (info.port == PortKind::sensor && unit == "as the state") return unit_of_field(model.state_names[port]);
  const std::size_t at = unit.find(" or ");
  if (at == std::string::npos || info.port == PortKind::body) return unit;
  return turns(info.port, port, model) ? unit.substr(at + 4) : unit.substr(0, at);
}

Words parameter_units(const tiller_config_t& config, const Words& names) {
  Words units;
  for (std::uint32_t i = 0; i < config.model->param_count && i < names.size(); ++i)
    units.push_back(unit_of_field(names[i]));
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    for (int i = 0; i < info.param_count; ++i)
      units.push_back(unit_of_effect(info, i, config.effects[e].port, *config.model));
  }
  units.resize(names.size());
  return units;
}

Words port_names(const EffectInfo& info, const tiller_model_t& model) {
  Words names;
  for (std::uint32_t i = 0; i < port_count(info.port, model); ++i) names.emplace_back(port_name(info.port, model, i));
  if (port_fits(info, TILLER_EVERY_PORT, model)) names.emplace_back(port_name(info.port, model, TILLER_EVERY_PORT));
  return names;
}

std::optional<std::uint32_t> find_port(const EffectInfo& info, const tiller_model_t& model, const std::string& name) {
  const Words names = port_names(info, model);
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  const auto port = static_cast<std::uint32_t>(found - names.begin());
  return port < port_count(info.port, model) ? port : TILLER_EVERY_PORT;
}

bool is_goal(const tiller_config_t& config, std::uint32_t input) {
  bool goal = false;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    if (hook_of(effect.kind) != Hook::servo) continue;
    for_ports(effect_info(effect.kind), effect.port, *config.model,
              [&](std::uint32_t port) { goal = goal || port == input; });
  }
  return goal;
}

double least_of_unit(const std::string& name) {
  for (const std::string ending : {"_kg", "_kgm2", "length_m"})
    if (name.size() >= ending.size() && name.compare(name.size() - ending.size(), ending.size(), ending) == 0)
      return 0.0;
  return -INFINITY;
}

}  // namespace tiller::tools
