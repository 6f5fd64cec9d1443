#include "sim/plant/check.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "sim/effects/effects.hpp"

namespace tiller::sim {
namespace {

template <class List, class Name>
std::vector<std::string> names_of(const List& list, Name name) {
  std::vector<std::string> names;
  names.reserve(list.size());
  for (const auto& entry : list) names.push_back(name(entry));
  return names;
}

std::vector<std::string> channel_names(const std::vector<Channel>& channels) {
  return names_of(channels, [](const Channel& c) { return c.name; });
}

std::string list(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

std::string number(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

bool known(const std::string& name, const std::vector<std::string>& names, const std::string& what,
           std::string& error) {
  if (std::find(names.begin(), names.end(), name) != names.end()) return true;
  error = "unknown " + what + " '" + name + "'; known: " + list(names);
  return false;
}

bool not_negative(double value, const std::string& key, std::string& error) {
  if (std::isfinite(value) && value >= 0) return true;
  error = key + " = " + number(value) + ": must be a finite number, zero or more";
  return false;
}

bool check_parameters(const PlantOptions& o, const MechanismInfo& info, std::string& error) {
  const auto names = names_of(info.parameters, [](const ParameterInfo& p) { return p.name; });
  for (const auto& [name, value] : o.parameters) {
    if (!known(name, names, "parameter of " + info.kind, error)) return false;
    const auto at = std::find(names.begin(), names.end(), name) - names.begin();
    const ParameterInfo& p = info.parameters[static_cast<std::size_t>(at)];
    if (std::isfinite(value) && (value > p.minimum || (p.minimum_allowed && value == p.minimum))) continue;
    error = "parameter " + name + " = " + number(value) + ": must be " +
            (p.minimum_allowed ? "at least " : "greater than ") + number(p.minimum);
    return false;
  }
  return true;
}

bool check_initial_state(const PlantOptions& o, const MechanismInfo& info, std::string& error) {
  for (const auto& [name, value] : o.initial_state) {
    if (!known(name, channel_names(info.states), "state of " + info.kind, error)) return false;
    if (std::isfinite(value)) continue;
    error = "initial state " + name + " = " + number(value) + ": must be finite";
    return false;
  }
  return true;
}

std::vector<std::string> sensor_names(const PlantOptions& o, const MechanismInfo& info) {
  std::vector<std::string> names;
  for (const std::size_t i : measured_states(o, info)) names.push_back(info.states[i].name);
  return names;
}

bool check_encoders(const PlantOptions& o, const MechanismInfo& info, std::string& error) {
  const std::vector<std::string> names = sensor_names(o, info);
  for (const auto& [name, sd] : o.encoder_noise_sd) {
    if (!known(name, names, "measurement channel of " + info.kind, error)) return false;
    if (!not_negative(sd, "encoder noise of " + name, error)) return false;
  }
  for (const auto& [name, step] : o.encoder_step) {
    if (!known(name, names, "measurement channel of " + info.kind, error)) return false;
    if (!not_negative(step, "encoder step of " + name, error)) return false;
  }
  return true;
}

bool check_process_noise(const PlantOptions& o, const MechanismInfo& info, std::string& error) {
  if (o.process_noise_sd <= 0 || !info.joints.empty()) return true;
  error = "process_noise_sd = " + number(o.process_noise_sd) + ": a random force at a joint, and the plant " +
          info.kind + " has none; leave it out";
  return false;
}

bool check_times(const PlantOptions& o, std::string& error) {
  const double step_us = o.step_s * 1e6;
  if (!(step_us >= 1 && step_us <= 1000) || std::fabs(step_us - std::round(step_us)) > 1e-6) {
    error = "step_s = " + number(o.step_s) +
            ": must be a whole number of microseconds from 1e-06 to 0.001 (ODE is of first order in the step)";
    return false;
  }
  return not_negative(o.measurement_latency_s, "measurement_latency_s", error) &&
         not_negative(o.command_latency_s, "command_latency_s", error) &&
         not_negative(o.watchdog_timeout_s, "watchdog_timeout_s", error) &&
         not_negative(o.process_noise_sd, "process_noise_sd", error) &&
         not_negative(o.command_limit, "command_limit", error);
}

/// Names of the places where an effect of this kind may act.
std::vector<std::string> port_names(PortKind port, const PlantOptions& o, const MechanismInfo& info) {
  switch (port) {
    case PortKind::joint: return info.joints;
    case PortKind::command: return channel_names(info.commands);
    case PortKind::sensor: return sensor_names(o, info);
    case PortKind::body: return {"body"};
  }
  return {};
}

bool check_effect(const HiddenEffect& effect, const PlantOptions& o, const MechanismInfo& info, std::string& error) {
  const auto kinds = names_of(effect_infos(), [](const EffectInfo& e) { return e.kind; });
  if (!known(effect.kind, kinds, "hidden effect", error)) return false;
  const EffectInfo& what = *find_effect(effect.kind);
  if (what.port == PortKind::joint && info.joints.empty()) {
    error = "effect " + effect.kind + " acts at a joint, and the plant " + info.kind +
            " has none: its commands are velocities; effects at commands and sensors remain";
    return false;
  }
  if (find_port(effect, o, info) < 0) {
    return known(effect.port, port_names(what.port, o, info), "port of effect " + effect.kind + " on " + info.kind,
                 error);
  }
  const auto names = names_of(what.parameters, [](const EffectParameter& p) { return p.name; });
  for (const auto& [name, value] : effect.parameters) {
    if (!known(name, names, "parameter of effect " + effect.kind, error)) return false;
    const auto at = static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
    const bool is_signed = what.parameters[at].is_signed;
    if (std::isfinite(value) && (is_signed || value >= 0)) continue;
    error = "effect " + effect.kind + ": " + name + " = " + number(value) + ": must be finite" +
            (is_signed ? "" : " and not negative");
    return false;
  }
  for (const std::string& name : names) {
    if (effect.parameters.count(name)) continue;
    error = "effect " + effect.kind + " needs its parameter " + name + " (" + what.help + ")";
    return false;
  }
  return true;
}

bool check_effects(const PlantOptions& o, const MechanismInfo& info, std::string& error) {
  std::set<std::pair<std::string, int>> seen;
  for (const HiddenEffect& effect : o.effects) {
    if (!check_effect(effect, o, info, error)) return false;
    if (seen.insert({effect.kind, find_port(effect, o, info)}).second) continue;
    error = "effect " + effect.kind + " is given twice at one port; add the two to one";
    return false;
  }
  return true;
}

}  // namespace

std::vector<std::size_t> measured_states(const PlantOptions& options, const MechanismInfo& info) {
  std::vector<std::size_t> all = info.measured;
  for (std::size_t i = 0; options.rates && i < info.states.size(); ++i) {
    if (std::find(info.measured.begin(), info.measured.end(), i) == info.measured.end()) all.push_back(i);
  }
  return all;
}

int find_port(const HiddenEffect& effect, const PlantOptions& options, const MechanismInfo& info) {
  const EffectInfo* what = find_effect(effect.kind);
  if (what == nullptr) return -1;
  if (effect.port.empty()) return what->port == PortKind::joint ? static_cast<int>(info.actuated) : 0;
  const auto ports = port_names(what->port, options, info);
  const auto at = std::find(ports.begin(), ports.end(), effect.port);
  return at == ports.end() ? -1 : static_cast<int>(at - ports.begin());
}

std::map<std::string, double> merged_parameters(const PlantOptions& options, const MechanismInfo& info) {
  std::map<std::string, double> all = options.parameters;
  for (const ParameterInfo& p : info.parameters) all.emplace(p.name, p.default_value);
  return all;
}

bool check_options(const PlantOptions& options, const MechanismInfo& info, std::string& error) {
  return check_parameters(options, info, error) && check_initial_state(options, info, error) &&
         check_encoders(options, info, error) && check_times(options, error) &&
         check_process_noise(options, info, error) && check_effects(options, info, error);
}

}  // namespace tiller::sim
