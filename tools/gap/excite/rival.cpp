#include "tools/gap/excite/rival.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "posterior/prior.hpp"
#include "tiller/config.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::gap {
namespace {

double centre(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_fixed ? prior.a : from_coordinate(prior, prior_quantile(prior, 0.5));
}
double deviation(const tiller_prior_t& prior) {
  if (prior.kind == tiller_prior_fixed) return 0;
  return 0.25 *
         (from_coordinate(prior, prior_quantile(prior, 0.977)) - from_coordinate(prior, prior_quantile(prior, 0.023)));
}

/// Magnitudes that the robot file lets expect; a report's values go before them.
double typical(const RobotFile& robot, Scale scale, std::uint32_t port) {
  const tiller_config_t& c = robot.config;
  const std::uint32_t input = std::min(port, c.model->input_count - 1);
  const double drive = 0.25 * (c.safety.input_high[input] - c.safety.input_low[input]);
  constexpr double kTurn = 1.0, kTurn_s = 3.0;  // m or rad, and a second of it
  switch (scale) {
    case Scale::force: return 0.3 * drive;
    case Scale::force_per_velocity: return 0.3 * drive / kTurn_s;
    case Scale::force_per_velocity2: return 0.3 * drive / (kTurn_s * kTurn_s);
    case Scale::force_per_position2:
    case Scale::stiffness:
    case Scale::force_per_position: return 0.3 * drive / kTurn;
    case Scale::force_per_position3: return 0.3 * drive / (kTurn * kTurn * kTurn);
    case Scale::place:
    case Scale::position: return kTurn;
    case Scale::velocity: return kTurn_s;
    case Scale::input: return drive;
    case Scale::per_input: return 1 / drive;
    case Scale::period: return c.period_s;
    case Scale::spatial_period: return 0.3;
    default: return 1.0;
  }
}

/// The robot file's own, at the priors' centres.
Rival nominal(const RobotFile& robot) {
  Rival r;
  r.name = "nominal";
  r.config = robot.config;
  r.config.prior_mixture = nullptr;
  r.params = robot.names.params;
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    const tiller_prior_t& prior = robot.config.priors[i];
    r.value.push_back(centre(prior));
    r.spread.push_back(deviation(prior));
    r.low.push_back(prior.kind == tiller_prior_fixed ? prior.a : prior.low);
    r.high.push_back(prior.kind == tiller_prior_fixed ? prior.a : prior.high);
    r.stiff.push_back(false);
    r.given.push_back(true);
  }
  return r;
}

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == at)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

/// Of what a delay may become: its longest has to be known to the kernel.
void bound_delay(Rival& r, std::size_t index) {
  const double period_s = r.config.period_s;
  r.high[index] = std::min(TILLER_MAX_DELAY_STEPS * period_s, 3 * r.value[index] + 3 * period_s);
  r.config.priors[index] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, r.high[index]};
}

bool add_effect(const RobotFile& robot, std::uint32_t kind, std::uint32_t port, Rival& r, std::string& error) {
  const EffectInfo& info = effect_info(kind);
  Config& c = r.config;
  const std::string at = port_name(info.port, *c.model, port);
  if (!port_fits(info, port, *c.model)) {
    error = std::string(info.name) + " cannot stand at " + at + ": it needs " +
            (info.needs_position ? "a joint with a position" : "a joint that an input drives");
    return false;
  }
  if (c.effect_count >= TILLER_MAX_EFFECTS ||
      c.param_count + static_cast<std::uint32_t>(info.param_count) > TILLER_MAX_PARAMS) {
    error = "the robot file and its candidate have more effects or parameters than fit into a controller";
    return false;
  }
  for (int i = 0; i < info.param_count; ++i) {
    const EffectParam& p = info.params[i];
    const double start = p.start_count > 0 ? p.start[p.start_count / 2] : 0.3;
    r.params.push_back(at + "." + p.name);
    r.value.push_back(std::clamp(start * typical(robot, p.scale, first_port(info, port, *c.model)), p.low, p.high));
    r.spread.push_back(0);
    r.low.push_back(p.low);
    r.high.push_back(p.high);
    r.stiff.push_back(p.scale == Scale::stiffness);
    r.given.push_back(false);
    c.priors[c.param_count++] = {tiller_prior_fixed, 0, r.value.back(), 0.0, r.value.back(), r.value.back()};
  }
  c.effects[c.effect_count++] = {kind, port};
  r.effects.push_back({kind, port});
  return true;
}

/// What follows from the values: how far a refit may go, and the longest delay.
bool settle(Rival& r, std::string& error) {
  std::size_t index = r.value.size();
  for (std::size_t e = r.effects.size(); e-- > 0;)
    index -= static_cast<std::size_t>(effect_info(r.effects[e].kind).param_count);
  for (const EffectAt& e : r.effects) {
    for (int i = 0; i < effect_info(e.kind).param_count; ++i, ++index) {
      double& value = r.value[index];
      if (!(value >= r.low[index] && value <= r.high[index])) {
        error = r.params[index] + " = " + number_text(value) + " lies outside of what " + effect_info(e.kind).name +
                " allows, " + number_text(r.low[index]) + " .. " + number_text(r.high[index]);
        return false;
      }
      r.spread[index] = std::max(std::fabs(value), 1e-9);
      if (has_role(e.kind, kDelay | kLate)) bound_delay(r, index);
    }
  }
  StepSetup setup;
  if (make_step_setup(r.config, setup) == tiller_status_ok) return true;
  error = r.name + ": does not fit into this model";
  return false;
}

bool set_value(Rival& r, std::size_t first, const std::string& key, const std::string& text, std::string& error) {
  Words names;
  for (std::size_t i = first; i < r.params.size(); ++i) names.push_back(r.params[i].substr(r.params[i].rfind('.') + 1));
  const int index = index_of(names, key);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (index < 0) {
    error = "there is no parameter '" + key + "' here; write one of " + join(names);
    return false;
  }
  if (text.empty() || *end != 0 || !std::isfinite(value)) {
    error = key + " = '" + text + "' is no number";
    return false;
  }
  r.value[first + static_cast<std::size_t>(index)] = value;
  r.given[first + static_cast<std::size_t>(index)] = true;
  return true;
}

bool find_place(const RobotFile& robot, const EffectInfo& info, const std::string& name, std::uint32_t& port,
                std::string& error) {
  const tiller_model_t& model = *robot.config.model;
  Words fitting;
  for_ports(info, TILLER_EVERY_PORT, model,
            [&](std::uint32_t p) { fitting.emplace_back(port_name(info.port, model, p)); });
  const auto found = find_port(info, model, name.empty() && fitting.size() == 1 ? fitting[0] : name);
  if (found) {
    port = *found;
    return true;
  }
  error = name.empty() ? std::string(info.name) + " has more than one place here: write " + info.name + "@" +
                             join(fitting, " or ...@")
                       : std::string(model.name) + " has no " + port_kind_name(info.port) + " '" + name + "' for " +
                             info.name + "; write one of " + join(port_names(info, model));
  return false;
}

bool parse_effect(const RobotFile& robot, const std::string& text, Rival& r, std::string& error) {
  const std::size_t colon = text.find(':'), at = text.substr(0, colon).find('@');
  const std::string kind_name = text.substr(0, std::min(at, colon));
  const std::string port_text =
      at < colon ? text.substr(at + 1, colon == std::string::npos ? colon : colon - at - 1) : "";
  const int kind = find_effect(kind_name.c_str());
  if (kind < 0) {
    Words known;
    for (std::uint32_t k = 0; k < effect_kind_count(); ++k) known.emplace_back(effect_info(k).name);
    const std::string near = nearest(kind_name, known);
    error = "there is no effect '" + kind_name + "'" + (near.empty() ? "" : "; did you mean " + near + "?") +
            " (tiller effects lists them)";
    return false;
  }
  const auto k = static_cast<std::uint32_t>(kind);
  std::uint32_t port = 0;
  const std::size_t first = r.params.size();
  if (!find_place(robot, effect_info(k), port_text, port, error) || !add_effect(robot, k, port, r, error)) return false;
  if (colon == std::string::npos) return true;
  for (const std::string& pair : split(text.substr(colon + 1), ':')) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string::npos) {
      error = "'" + pair + "' is no parameter=value";
      return false;
    }
    if (!set_value(r, first, pair.substr(0, equals), pair.substr(equals + 1), error)) return false;
  }
  return true;
}

void name_it(Rival& r) {
  if (r.effects.empty()) return;
  Words names;
  for (const EffectAt& e : r.effects)
    names.push_back(std::string(effect_info(e.kind).name) + " (" +
                    port_name(effect_info(e.kind).port, *r.config.model, e.port) + ")");
  r.name = join(names, " + ");
}

bool kind_contains(std::uint32_t large, std::uint32_t small) {
  if (large == small) return true;
  for (const char* name : effect_info(large).contains)
    if (name && find_effect(name) == static_cast<int>(small)) return true;
  return false;
}

}  // namespace

bool parse_rival(const RobotFile& robot, const std::string& text, Rival& rival, std::string& error) {
  rival = nominal(robot);
  if (text == "nominal") return true;
  for (const std::string& part : split(text, '+'))
    if (!parse_effect(robot, part, rival, error)) {
      error = "candidate '" + text + "': " + error;
      return false;
    }
  name_it(rival);
  return settle(rival, error);
}

bool contains(const Rival& large, const Rival& small) {
  for (const EffectAt& s : small.effects) {
    const bool there = std::any_of(large.effects.begin(), large.effects.end(), [&](const EffectAt& l) {
      return l.port == s.port && kind_contains(l.kind, s.kind);
    });
    if (!there) return false;
  }
  return true;
}

namespace {

constexpr double kStiffest_sd = 2;  // of a stiffness's estimate

/// An explanation of a gap.json as a rival: its effects, and its estimates of every parameter.
bool rival_of(const RobotFile& robot, const nlohmann::json& explanation, Rival& r, std::string& error) {
  Words parts;
  Words changed;  // of the robot file's own parameters
  for (const auto& e : explanation.at("effects")) {
    const auto port = e.at("port").get<std::string>();
    if (e.value("port_kind", "") == "parameter")
      changed.push_back(port);
    else
      parts.push_back(e.at("kind").get<std::string>() + "@" + port);
  }
  if (!parse_rival(robot, parts.empty() ? "nominal" : join(parts, "+"), r, error)) return false;
  for (const auto& p : explanation.at("parameters")) {
    const int index = index_of(r.params, p.at("name").get<std::string>());
    if (index < 0 || !p.at("mean").is_number()) continue;
    const auto i = static_cast<std::size_t>(index);
    if (std::find(changed.begin(), changed.end(), r.params[i]) != changed.end()) {
      r.low[i] = r.low[i] < 0 ? -HUGE_VAL : 0;
      r.high[i] = HUGE_VAL;
      r.spread[i] = std::max(std::fabs(p.at("mean").get<double>()), 1e-9);
      r.config.priors[i] = {tiller_prior_fixed, 0, p.at("mean").get<double>(), 0, 0, 0};
    }
    // the stiffest spring that the report leaves possible: what tells a softer one from a rigid joint is a promise less
    const double sd = p.value("sd", nlohmann::json()).is_number() ? p.at("sd").get<double>() : 0.0;
    const double stiffer = r.stiff[i] ? kStiffest_sd * sd : 0.0;
    r.value[i] = std::clamp(p.at("mean").get<double>() + stiffer, r.low[i], r.high[i]);
    r.given[i] = true;
    if (i >= robot.names.params.size() && r.config.priors[i].kind == tiller_prior_fixed)
      r.config.priors[i].a = r.config.priors[i].low = r.config.priors[i].high = r.value[i];
  }
  return settle(r, error);
}

}  // namespace

bool read_rivals(const RobotFile& robot, const std::string& path, std::vector<Rival>& rivals, std::string& error) {
  constexpr std::size_t kMost = 4;
  std::ifstream file(path);
  if (!file) {
    error = path + ": cannot be read; give the gap.json that `tiller gap` wrote";
    return false;
  }
  const nlohmann::json report = nlohmann::json::parse(file, nullptr, false);
  if (report.is_discarded() || !report.is_object() || !report.contains("ranking") || !report["ranking"].is_array()) {
    error = path + ": is no gap.json; give the file that `tiller gap` wrote";
    return false;
  }
  std::vector<std::size_t> chosen;
  if (report.contains("ambiguity") && report["ambiguity"].is_array())
    for (const auto& i : report["ambiguity"])
      if (i.is_number_unsigned()) chosen.push_back(i.get<std::size_t>());
  for (std::size_t i = 0; i < report["ranking"].size() && chosen.size() < 2; ++i)
    if (std::find(chosen.begin(), chosen.end(), i) == chosen.end()) chosen.push_back(i);
  if (chosen.size() > kMost) chosen.resize(kMost);
  try {
    for (const std::size_t i : chosen) {
      Rival r;
      if (!rival_of(robot, report["ranking"].at(i), r, error)) {
        error = path + ": " + error + "; was it written for this robot file?";
        return false;
      }
      rivals.push_back(std::move(r));
    }
  } catch (const std::exception& e) {
    error = path + ": is not laid out as a gap.json (" + e.what() + ")";
    return false;
  }
  return true;
}

}  // namespace tiller::tools::gap
