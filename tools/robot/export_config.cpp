#include "tools/robot/export_config.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "costs/cost_term_info.hpp"
#include "effects/effect_info.hpp"
#include "tools/robot/export_build.hpp"
#include "tools/robot/export_networks.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

std::string c_number(double value) {
  if (std::isnan(value)) return "NAN";
  if (std::isinf(value)) return value > 0 ? "INFINITY" : "-INFINITY";
  const std::string text = number_text(value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

/// Writes designated initialisers; what is zero is left out, as C fills it with zero.
class Initialiser {
 public:
  explicit Initialiser(std::string indent) : indent_(std::move(indent)) {}

  void word(const std::string& field, const std::string& value) {
    text_ += indent_ + "." + field + " = " + value + ",\n";
  }
  void count(const std::string& field, std::uint64_t value) { word(field, std::to_string(value) + "u"); }
  void number(const std::string& field, double value) { word(field, c_number(value)); }

  void numbers(const std::string& field, const double* values, std::size_t size, const Words& names) {
    std::string list;
    for (std::size_t i = 0; i < size; ++i) {
      // -0.0 and NaN are not zero bits: only true zeros are left out
      if (values[i] == 0 && !std::signbit(values[i])) continue;
      const std::string name = i < names.size() ? " /* " + names[i] + " */" : "";
      list += indent_ + "  [" + std::to_string(i) + "] = " + c_number(values[i]) + "," + name + "\n";
    }
    if (!list.empty()) word(field, "{\n" + list + indent_ + "}");
  }

  void group(const char* field, const Initialiser& inner) { word(field, "{\n" + inner.text() + indent_ + "}"); }
  const std::string& text() const { return text_; }
  const std::string& indent() const { return indent_; }

 private:
  std::string indent_;
  std::string text_;
};

std::string enum_name(const char* prefix, const Words& names, std::uint32_t value) {
  return "tiller_" + std::string(prefix) + "_" + names.at(value);
}

/// The definition of an array of its own, which the configuration points to.
std::string definition(const std::string& type, const std::string& name, std::size_t count, const std::string& rows) {
  return "static const " + type + " " + name + "[" + std::to_string(count) + "] = {\n" + rows + "};\n\n";
}

std::string effects_text(const RobotFile& robot, const std::string& prefix) {
  if (robot.config.effect_count == 0) return "";
  std::string rows;
  for (std::uint32_t i = 0; i < robot.config.effect_count; ++i) {
    const tiller_effect_t& e = robot.config.effects[i];
    rows += "  {" + enum_name("effect", effect_names(), e.kind) + ", " + std::to_string(e.port) + "u},\n";
  }
  return definition("tiller_effect_t", prefix + "_effects", robot.config.effect_count, rows);
}

std::string priors_text(const RobotFile& robot, const std::string& prefix) {
  if (robot.config.param_count == 0) return "";
  const Words kinds = {"fixed", "uniform", "normal", "log_normal"};
  std::string rows;
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    const tiller_prior_t& p = robot.config.priors[i];
    rows += "  {" + enum_name("prior", kinds, p.kind) + ", 0, " + c_number(p.a) + ", " + c_number(p.b) + ", " +
            c_number(p.low) + ", " + c_number(p.high) + "}, /* " + robot.names.params[i] + " */\n";
  }
  return definition("tiller_prior_t", prefix + "_priors", robot.config.param_count, rows);
}

std::string measured_text(const RobotFile& robot) {
  std::string text;
  for (std::uint32_t i = 0; i < robot.config.measurement_count; ++i) {
    text += (i ? ", " : "") + std::to_string(robot.config.measured_state[i]);
  }
  return "{" + text + "}";
}

/// The settings of config.def that stand in one struct of the configuration: "planner", "" for the outermost.
void write_settings(Initialiser& part, const RobotFile& robot, const std::string& group) {
  for (const KeySpec& key : robot_keys()) {
    if (!key.field) continue;
    const std::string path = key.field;
    const std::size_t dot = path.find('.');
    if (group != (dot == std::string::npos ? "" : path.substr(0, dot))) continue;
    const std::string field = dot == std::string::npos ? path : path.substr(dot + 1);
    const char* const at = reinterpret_cast<const char*>(&robot.config) + key.offset;
    const auto& whole = *reinterpret_cast<const std::uint32_t*>(at);
    const double* const numbers = reinterpret_cast<const double*>(at);
    switch (key.kind) {
      case KeyKind::choice: part.word(field, enum_name(key.enum_prefix, key.choices(), whole)); break;
      case KeyKind::number: part.number(field, *numbers); break;
      case KeyKind::state_numbers: part.numbers(field, numbers, TILLER_MAX_STATES, robot.names.states); break;
      case KeyKind::input_numbers: part.numbers(field, numbers, TILLER_MAX_INPUTS, robot.names.inputs); break;
      default: part.count(field, whole);
    }
  }
}

Initialiser posterior_part(const RobotFile& robot) {
  Initialiser part("    ");
  write_settings(part, robot, "posterior");
  const tiller_posterior_config_t& p = robot.config.posterior;
  part.count("forgetting_count", p.forgetting_count);
  part.word("forgetting", "{" + c_number(p.forgetting[0]) + ", " + c_number(p.forgetting[1]) + ", " +
                              c_number(p.forgetting[2]) + "}");
  if (p.drift != 0) part.word("drift", std::to_string(p.drift) + "u");
  return part;
}

/// A part of the configuration that holds settings of config.def alone.
Initialiser plain_part(const RobotFile& robot, const char* group) {
  Initialiser part("    ");
  write_settings(part, robot, group);
  return part;
}

std::string terms_text(const RobotFile& robot, const std::string& prefix) {
  if (robot.config.cost.term_count == 0) return "";
  std::string rows;
  for (std::uint32_t i = 0; i < robot.config.cost.term_count; ++i) {
    const tiller_cost_term_t& term = robot.config.terms[i];
    const CostTermInfo& info = cost_term_info(term.kind);
    Words indices, names, params;
    for (std::uint32_t k = 0; k < info.state_count; ++k) {
      indices.push_back(std::to_string(term.states[k]) + "u");
      names.push_back(robot.names.states[term.states[k]]);
    }
    for (std::uint32_t k = 0; k < std::max(info.param_count, 1u); ++k) params.push_back(c_number(term.params[k]));
    rows += std::string("  {tiller_cost_term_") + cost_term_key(term.kind) + ", {" + join(indices) + "}, 0u, " +
            c_number(term.weight) + ", {" + join(params) + "}}, /* " + join(names) + " */\n";
  }
  return definition("tiller_cost_term_t", prefix + "_terms", robot.config.cost.term_count, rows);
}

std::string cones_text(const RobotFile& robot, const std::string& prefix) {
  if (robot.config.safety.cone_count == 0) return "";
  std::string rows;
  for (std::uint32_t c = 0; c < robot.config.safety.cone_count; ++c) {
    const tiller_input_cone_t& cone = robot.config.safety.cones[c];
    Words norm;
    for (std::size_t i = 0; i < robot.names.inputs.size(); ++i)
      if ((cone.inputs >> i) & 1u) norm.push_back(robot.names.inputs[i]);
    rows += "  {" + std::to_string(cone.inputs) + "u, " + std::to_string(cone.axis) + "u, " + c_number(cone.slope) +
            ", " + c_number(cone.limit) + "}, /* " + join(norm) +
            (cone.slope > 0.0 ? "; along " + robot.names.inputs[cone.axis] : "") + " */\n";
  }
  return definition("tiller_input_cone_t", prefix + "_cones", robot.config.safety.cone_count, rows);
}

/// Rows of values; nothing where there are none.
std::string array_text(const std::string& name, const double* values, std::size_t rows, std::size_t columns) {
  if (!values) return "";
  std::string text;
  for (std::size_t k = 0; k < rows; ++k) {
    text += "  ";
    for (std::size_t i = 0; i < columns; ++i) text += c_number(values[k * columns + i]) + ",";
    text += "\n";
  }
  return definition("double", name, rows * columns, text);
}

/// One value for each name, unless all say the same as none: the arrays that may be left out.
class OptionalArrays {
 public:
  OptionalArrays(const RobotFile& robot, std::string prefix) : prefix_(std::move(prefix)) {
    const tiller_cost_config_t& c = robot.config.cost;
    const tiller_safety_config_t& s = robot.config.safety;
    add("state_low", c.state_low, robot.names.states, -HUGE_VAL);
    add("state_high", c.state_high, robot.names.states, HUGE_VAL);
    add("bound_weight", c.bound_weight, robot.names.states, 0.0);
    add("hold_gain", s.hold_gain, gain_names(robot), 0.0);
    add("measurement_low", s.measurement_low, robot.names.measurements, -HUGE_VAL);
    add("measurement_high", s.measurement_high, robot.names.measurements, HUGE_VAL);
    add("until_sd", robot.config.probe.until_sd, robot.names.params, HUGE_VAL);
    add("measurement_rate_per_s", s.measurement_rate_per_s, robot.names.measurements, HUGE_VAL);
  }

  const std::string& text() const { return text_; }
  void point(Initialiser& part, const std::string& field) const {
    if (text_.find(" " + prefix_ + "_" + field + "[") != std::string::npos) part.word(field, prefix_ + "_" + field);
  }

 private:
  static Words gain_names(const RobotFile& robot) {
    Words names;
    for (const std::string& input : robot.names.inputs)
      for (const std::string& state : robot.names.states) names.push_back(input + ", " + state);
    return names;
  }

  void add(const std::string& field, const double* values, const Words& names, double none) {
    if (!values || std::all_of(values, values + names.size(), [&](double v) { return v == none; })) return;
    std::string rows;
    for (std::size_t i = 0; i < names.size(); ++i) rows += "  " + c_number(values[i]) + ", /* " + names[i] + " */\n";
    text_ += definition("double", prefix_ + "_" + field, names.size(), rows);
  }

  std::string prefix_, text_;
};

/// The joint prior with its arrays; nothing where there is none.
std::string mixture_text(const RobotFile& robot, const std::string& prefix) {
  const tiller_mixture_t* m = robot.config.prior_mixture;
  if (!m) return "";
  const std::size_t d = m->dimension;
  return array_text(prefix + "_prior_weight", m->weight, m->components, 1) +
         array_text(prefix + "_prior_mean", m->mean, m->components, d) +
         array_text(prefix + "_prior_root", m->root, m->components * d, d) + "static const tiller_mixture_t " + prefix +
         "_prior = {sizeof(tiller_mixture_t), TILLER_CONFIG_VERSION, " + std::to_string(m->components) + "u, " +
         std::to_string(d) + "u, " + prefix + "_prior_weight, " + prefix + "_prior_mean, " + prefix +
         "_prior_root};\n\n";
}

/// The outputs' costs, which the configuration points to.
std::string outputs_text(const RobotFile& robot, const std::string& prefix) {
  const tiller_cost_config_t& c = robot.config.cost;
  if (!c.outputs) return "";
  std::string text;
  for (std::uint32_t j = 0; j < c.output_count; ++j) {
    const tiller_output_cost_t& o = c.outputs[j];
    text += "  {" + c_number(o.target) + ", " + c_number(o.weight) + ", " + c_number(o.terminal_weight) + ", " +
            c_number(o.low) + ", " + c_number(o.high) + ", " + c_number(o.bound_weight) + "}, /* " +
            robot.names.outputs[j] + " */\n";
  }
  return definition("tiller_output_cost_t", prefix + "_outputs", c.output_count, text);
}

std::string arrays_text(const RobotFile& robot, const std::string& prefix) {
  const tiller_cost_config_t& c = robot.config.cost;
  const std::size_t nx = robot.names.states.size();
  return effects_text(robot, prefix) + priors_text(robot, prefix) + mixture_text(robot, prefix) +
         networks_text(robot, prefix) + OptionalArrays(robot, prefix).text() + terms_text(robot, prefix) +
         cones_text(robot, prefix) + array_text(prefix + "_reference", c.reference, c.reference_steps, nx) +
         array_text(prefix + "_demonstration_mean", c.demonstration_mean, c.demonstration_steps, nx) +
         array_text(prefix + "_demonstration_root", c.demonstration_root, c.demonstration_steps, nx * nx) +
         outputs_text(robot, prefix);
}

Initialiser probe_part(const RobotFile& robot, const std::string& prefix) {
  Initialiser part("    ");
  write_settings(part, robot, "probe");
  OptionalArrays(robot, prefix).point(part, "until_sd");
  return part;
}

Initialiser cost_part(const RobotFile& robot, const std::string& prefix) {
  const tiller_cost_config_t& c = robot.config.cost;
  Initialiser part("    ");
  write_settings(part, robot, "cost");
  const OptionalArrays arrays(robot, prefix);
  part.count("term_count", c.term_count);
  for (const char* field : {"state_low", "state_high", "bound_weight"}) arrays.point(part, field);
  part.count("hard_bounds", c.hard_bounds);
  if (c.term_count > 0) part.word("terms", prefix + "_terms");
  if (c.reference) part.word("reference", prefix + "_reference");
  if (c.demonstration_mean) {
    part.word("demonstration_mean", prefix + "_demonstration_mean");
    part.word("demonstration_root", prefix + "_demonstration_root");
  }
  if (c.outputs) part.word("outputs", prefix + "_outputs");
  part.count("output_count", c.output_count);
  part.count("reference_steps", c.reference_steps);
  part.count("demonstration_steps", c.demonstration_steps);
  return part;
}

Initialiser safety_part(const RobotFile& robot, const std::string& prefix) {
  const tiller_safety_config_t& s = robot.config.safety;
  Initialiser part("    ");
  part.numbers("input_low", s.input_low, TILLER_MAX_INPUTS, robot.names.inputs);
  part.numbers("input_high", s.input_high, TILLER_MAX_INPUTS, robot.names.inputs);
  part.numbers("input_rate_per_s", s.input_rate_per_s, TILLER_MAX_INPUTS, robot.names.inputs);
  part.numbers("safe_command", s.safe_command, TILLER_MAX_INPUTS, robot.names.inputs);
  const OptionalArrays arrays(robot, prefix);
  for (const char* field : {"hold_gain", "measurement_low", "measurement_high", "measurement_rate_per_s"})
    arrays.point(part, field);
  write_settings(part, robot, "safety");
  part.count("cone_count", s.cone_count);
  if (s.cone_count > 0) part.word("cones", prefix + "_cones");
  return part;
}

std::string config_text(const RobotFile& robot, const std::string& prefix) {
  const tiller_config_t& c = robot.config;
  Initialiser all("  ");
  all.word("size", "sizeof(tiller_config_t)");
  all.word("version", "TILLER_CONFIG_VERSION");
  all.count("seed", c.seed);
  write_settings(all, robot, "");
  all.group("body", plain_part(robot, "body"));
  all.count("effect_count", c.effect_count);
  all.count("param_count", c.param_count);
  if (c.effect_count > 0) all.word("effects", prefix + "_effects");
  if (c.param_count > 0) all.word("priors", prefix + "_priors");
  all.count("measurement_count", c.measurement_count);
  all.word("measured_state", measured_text(robot));
  all.numbers("measurement_sd", c.measurement_sd, TILLER_MAX_MEASUREMENTS, robot.names.measurements);
  all.group("posterior", posterior_part(robot));
  if (c.prior_mixture) all.word("prior_mixture", "&" + prefix + "_prior");
  if (c.network) all.word("network", "&" + prefix + "_network");
  if (c.policy && c.planner.kind == tiller_planner_policy) all.word("policy", "&" + prefix + "_policy");
  all.group("planner", plain_part(robot, "planner"));
  all.group("probe", probe_part(robot, prefix));
  all.group("cost", cost_part(robot, prefix));
  all.group("safety", safety_part(robot, prefix));
  return all.text();
}

/// How the program that links this gets the model.
std::string model_text(const RobotFile& robot, std::string& declaration) {
  if (!robot.model_request.name.empty()) return "tiller_find_model(\"" + robot.model_request.name + "\")";
  declaration = "/* The model of " + std::filesystem::path(robot.model_request.file).filename().string() +
                ": compile and link that file too. */\n"
                "const tiller_model_t* tiller_model(void);\n" +
                (robot.config.cost.own ? "const tiller_own_cost_t* tiller_cost(void);\n" : "") + "\n";
  return "tiller_model()";
}

/// The file's purpose, its name, and how to build it.
std::string head_text(const RobotFile& robot, const std::string& prefix, const std::string& config_file) {
  const std::string file = std::filesystem::path(robot.path).filename().string();
  const std::string extension = std::filesystem::path(robot.model_request.file).extension().string();
  std::string text =
      "/* Written by `tiller export` from " + file +
      "; edit that file instead.\n *\n *     tiller_config_t config = " + prefix +
      "_config();\n *     size_t size = tiller_size(&config);\n *\n" +
      " * To build it into a program, with this file and main.o (your loop around tiller_tick) in the folder of\n * " +
      file + ", and tiller installed (cmake --install build/release --prefix /opt/tiller):\n *\n" +
      build_commands(robot, config_file, " *     ") +
      " *\n * C's driver links it: the libraries need nothing of the C++ library.\n";
  if (extension == ".hpp")
    text += std::string(" * The model is compiled for processors with ") + tiller_instruction_set() +
            "; docs/guide/own_model.md has the flags of the others.\n";
  return text + " */\n";
}

}  // namespace

std::string c_identifier(const std::string& name) {
  std::string id;
  for (const char c : name) id += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  if (id.empty() || std::isdigit(static_cast<unsigned char>(id[0]))) id = "robot_" + id;
  return id;
}

std::string export_c(const RobotFile& robot, const std::string& prefix, const std::string& config_file) {
  std::string declaration;
  const std::string model = model_text(robot, declaration);
  return head_text(robot, prefix, config_file) + "#include <math.h>\n\n#include \"tiller/tiller.h\"\n\n" +
         "#if TILLER_VERSION_MAJOR != " + std::to_string(TILLER_VERSION_MAJOR) +
         "\n#error \"this configuration was exported for another version of tiller: run tiller export again\"\n"
         "#endif\n\n" +
         declaration + arrays_text(robot, prefix) + "static const tiller_config_t " + prefix + "_constants = {\n" +
         config_text(robot, prefix) + "};\n\ntiller_config_t " + prefix + "_config(void);\ntiller_config_t " + prefix +
         "_config(void) {\n  tiller_config_t config = " + prefix + "_constants;\n  config.model = " + model + ";\n" +
         (robot.config.cost.own ? "  config.cost.own = tiller_cost();\n" : "") + "  return config;\n}\n";
}

}  // namespace tiller::tools
