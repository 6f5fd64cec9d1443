// [parameters], [[effects]] and the priors in both.

#include <algorithm>
#include <cmath>
#include <limits>

#include "effects/effect_info.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr const char* kPriorRemedy =
    "write a number, { uniform = [low, high] }, { normal = [mean, sd] } or { log_normal = [median, sd of log] }";

const KeySpec kAnyNumber = {
    "",    "", KeyKind::number, "", "",      -TILLER_LARGEST_PARAMETER, TILLER_LARGEST_PARAMETER,
    false, -1, nullptr,         "", nullptr, TILLER_SMALLEST_PARAMETER};

struct PriorForm {
  const char* name;
  tiller_prior_kind_t kind;
};
constexpr PriorForm kForms[] = {
    {"uniform", tiller_prior_uniform}, {"normal", tiller_prior_normal}, {"log_normal", tiller_prior_log_normal}};

bool read_pair(FileErrors& errors, const toml::node& node, const std::string& path, double pair[2]) {
  const toml::array* list = node.as_array();
  if (!list || list->size() != 2) {
    errors.at(node, path, "is no list of two numbers", kPriorRemedy);
    return false;
  }
  for (std::size_t i = 0; i < 2; ++i) {
    const auto value = checked_number(errors, *list->get(i), path, kAnyNumber);
    if (!value) return false;
    pair[i] = *value;
  }
  return true;
}

bool check_form(FileErrors& errors, const toml::node& node, const std::string& path, tiller_prior_kind_t kind,
                const double pair[2]) {
  if (kind == tiller_prior_uniform && pair[0] >= pair[1]) {
    const bool equal = pair[0] == pair[1];
    errors.at(node, path, equal ? "the range is empty" : "the range is reversed",
              equal ? "write the number " + number_text(pair[0]) + " for a known parameter"
                    : "write [" + number_text(pair[1]) + ", " + number_text(pair[0]) + "]");
    return false;
  }
  if (kind != tiller_prior_uniform && !(pair[1] > 0)) {
    errors.at(node, path, "the standard deviation is not positive",
              "write a positive second number, or the number " + number_text(pair[0]) + " for a known parameter");
    return false;
  }
  if (kind == tiller_prior_log_normal && !(pair[0] > 0)) {
    errors.at(node, path, "the median of a log-normal is not positive", "write a positive first number, or use normal");
    return false;
  }
  return true;
}

void read_prior_table(FileErrors& errors, const toml::table& table, const std::string& path, tiller_prior_t& out) {
  SectionReader section(errors, "prior", path, &table);
  const std::size_t before = errors.list().size();
  section.refuse_unknown();
  int forms = 0;
  double pair[2] = {0, 0};
  for (const PriorForm& form : kForms) {
    const toml::node* node = section.node(form.name);
    if (!node) continue;
    ++forms;
    if (!read_pair(errors, *node, path + "." + form.name, pair)) return;
    if (!check_form(errors, *node, path + "." + form.name, form.kind, pair)) return;
    out.kind = form.kind;
  }
  const auto low = section.number("low");
  const auto high = section.number("high");
  if (errors.list().size() != before) return;
  if (forms != 1) {
    errors.at(table, path, forms == 0 ? "is no prior" : "has more than one prior", kPriorRemedy);
    return;
  }
  const bool uniform = out.kind == tiller_prior_uniform;
  if (uniform && (low || high)) {
    errors.at(table, path, "a uniform prior has its bounds already", "leave low and high out");
    return;
  }
  if (!section.in_order("low", low, "high", high)) return;
  out.a = pair[0];
  out.b = pair[1];
  out.low = uniform ? pair[0] : low.value_or(-kInf);
  out.high = uniform ? pair[1] : high.value_or(kInf);
}

/// "at least 0", "0 .. 1": the values that a parameter may have at all.
std::string range_text(double low, double high) {
  if (std::isfinite(low) && std::isfinite(high)) return number_text(low) + " .. " + number_text(high);
  return std::isfinite(low) ? "at least " + number_text(low) : "at most " + number_text(high);
}

void read_effect_params(SectionReader& section, const EffectInfo& info, const std::string& port, RobotFile& robot) {
  Words names;
  for (int i = 0; i < info.param_count; ++i) names.emplace_back(info.params[i].name);
  const Words meant = section.refuse_unknown(names);
  for (int i = 0; i < info.param_count; ++i) {
    const std::string& name = names[static_cast<std::size_t>(i)];
    robot.names.params.push_back(port + "." + name);
    if (robot.names.params.size() > TILLER_MAX_PARAMS) continue;
    tiller_prior_t& prior = robot.config.priors[robot.names.params.size() - 1];
    if (const toml::node* node = section.node(name)) {
      read_prior(section.errors(), *node, section.path_of(name), info.params[i].low, info.params[i].high, prior);
    } else if (info.learnt) {
      prior = {tiller_prior_uniform, 0, info.params[i].low, info.params[i].high, info.params[i].low,
               info.params[i].high};  // until the network is read
    } else if (index_of(meant, name) < 0) {
      section.missing(name, std::string("give it a value or a prior: ") + kPriorRemedy);
    }
  }
}

/// Why a controller has no room for one more effect; empty: it has.
std::string why_no_room(const tiller_config_t& config, const tiller_effect_t& more) {
  std::uint32_t effects = 0, states = 0;
  const auto count = [&](const tiller_effect_t& e) {
    const EffectInfo& info = effect_info(e.kind);
    const std::uint32_t ports = ports_of(info, e.port, *config.model);
    effects += ports;
    states += ports * static_cast<std::uint32_t>(info.state_count);
  };
  std::for_each(config.effects, config.effects + config.effect_count, count);
  count(more);
  if (effects > TILLER_MAX_EFFECTS)
    return "too many effects: " + std::to_string(effects) + ", at most " + std::to_string(TILLER_MAX_EFFECTS);
  if (states > TILLER_MAX_EFFECT_STATES)
    return "the effects have " + std::to_string(states) + " states of their own, at most " +
           std::to_string(TILLER_MAX_EFFECT_STATES);
  return "";
}

void read_effect(FileErrors& errors, const toml::table& table, std::size_t index, RobotFile& robot) {
  SectionReader section(errors, "effects[]", "effects[" + std::to_string(index) + "]", &table);
  const auto kind = section.choice("kind");
  if (!section.has("kind")) section.missing("kind", "write kind = one of: " + join(effect_names()));
  const auto port = section.text("port");
  if (!kind) return;
  const EffectInfo& info = effect_info(*kind);
  const Words known = port_names(info, *robot.config.model);
  const auto place = find_port(info, *robot.config.model, port.value_or(""));
  const std::string what = port_kind_name(info.port);
  if (info.port == PortKind::joint && robot.config.model->joint_count == 0) {
    section.error("kind",
                  std::string(info.name) + " acts at a joint, and " + robot.config.model->name +
                      " has none (a kinematic model moves without forces)",
                  "choose among the effects of an input, a sensor or the body (`tiller effects`), or leave it out");
    return;
  }
  if (!section.has("port")) {
    if (info.port != PortKind::body)
      section.missing("port", "write port = one of the model's " + what + "s: " + join(known));
  } else if (port && !place) {
    section.error("port", std::string(robot.config.model->name) + " has no " + what + " of that name for " + info.name,
                  remedy_for_unknown(*port, known));
  } else if (port && !port_fits(info, *place, *robot.config.model)) {
    section.error("port",
                  *port + std::string(" has no ") + (info.needs_position ? "position" : "drive") + ", which " +
                      info.name + " needs",
                  "choose another port, or leave the effect out");
  }
  const std::string full = why_no_room(robot.config, {*kind, place.value_or(0)});
  if (!full.empty()) {
    errors.at_table(table, section.path_of("kind"), full, "leave effects out; one at all ports counts at each");
    return;
  }
  tiller_effect_t& effect = robot.config.effects[robot.config.effect_count++];
  effect.kind = *kind;
  effect.port = place.value_or(0);
  read_effect_params(section, info, port.value_or(info.port == PortKind::body ? "body" : "?"), robot);
}

}  // namespace

void read_prior(FileErrors& errors, const toml::node& node, const std::string& path, double hard_low, double hard_high,
                tiller_prior_t& out) {
  const std::size_t before = errors.list().size();
  if (const toml::table* table = node.as_table()) {
    read_prior_table(errors, *table, path, out);
    if (errors.list().size() != before) return;
    const bool cut = out.kind != tiller_prior_uniform;
    if (cut && out.low < hard_low) out.low = hard_low;  // no sense in asking for what physics rules out
    if (cut && out.high > hard_high) out.high = hard_high;
    if (cut && out.low >= out.high) {
      errors.at(node, path, "its bounds leave nothing of what physics allows, " + range_text(hard_low, hard_high),
                "correct low and high");
    }
    if (!cut && out.high > hard_high) {
      errors.at(node, path, "the range reaches above " + number_text(hard_high),
                "end the range at " + number_text(hard_high) + " or below");
    }
    if (!cut && out.low < hard_low) {
      errors.at(node, path, "the range reaches below " + number_text(hard_low),
                "start the range at " + number_text(hard_low) + " or above");
    }
    return;
  }
  if (!node.is_number()) {
    errors.at(node, path, "is " + kind_text(node), kPriorRemedy);
    return;
  }
  KeySpec spec = kAnyNumber;
  spec.low = std::fmax(hard_low, spec.low);
  spec.high = std::fmin(hard_high, spec.high);
  if (const auto value = checked_number(errors, node, path, spec)) {
    out = {tiller_prior_fixed, 0, *value, 0, *value, *value};
  }
}

void read_parameters(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "parameters");
  SectionReader section(errors, "parameters", "parameters", table);
  const Words names(robot.names.params.begin(), robot.names.params.begin() + robot.config.model->param_count);
  const Words meant = section.refuse_unknown(names);
  Words lacking;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (const toml::node* node = section.node(names[i])) {
      read_prior(errors, *node, section.path_of(names[i]), least_of_unit(names[i]), kInf, robot.config.priors[i]);
    } else if (index_of(meant, names[i]) < 0) {
      lacking.push_back(names[i]);
    }
  }
  if (!lacking.empty()) {
    errors.missing(
        table, "parameters." + join(lacking, ", parameters."),
        std::string("every parameter of ") + robot.config.model->name + " needs a value or a prior: " + kPriorRemedy);
  }
}

void read_effects(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::node* node = root.get("effects");
  if (node && !node->is_array()) {
    errors.at_table(*node, "effects", "is " + kind_text(*node), "head each effect with [[effects]]");
  } else if (node) {
    std::size_t index = 0;
    for (const toml::node& element : *node->as_array()) {
      ++index;
      if (const toml::table* table = element.as_table()) {
        read_effect(errors, *table, index, robot);
      } else {
        errors.at(element, "effects", "is " + kind_text(element), "head each effect with [[effects]]");
      }
    }
  }
  if (robot.names.params.size() > TILLER_MAX_PARAMS) {
    errors.at_table(*node, "effects",
                    "model and effects have " + std::to_string(robot.names.params.size()) + " parameters",
                    "keep at most " + std::to_string(TILLER_MAX_PARAMS));
  }
  robot.config.param_count = static_cast<std::uint32_t>(robot.names.params.size());
}

}  // namespace tiller::tools
