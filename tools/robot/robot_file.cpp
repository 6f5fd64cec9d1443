#include "tools/robot/robot_file.hpp"

#include <algorithm>
#include <filesystem>

#include "tools/robot/network_file.hpp"
#include "tools/robot/robot_equations.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

Words top_level_keys() {
  Words keys;
  for (const SectionSpec& section : robot_sections()) {
    const std::string name = section.name;
    if (name == "prior" || name.find('.') != std::string::npos) continue;
    keys.push_back(name.substr(0, name.find('[')));
  }
  return keys;
}

void refuse_unknown_sections(FileErrors& errors, const toml::table& root) {
  const Words known = top_level_keys();
  for (auto&& [name, node] : root) {
    const std::string word(name.str());
    if (index_of(known, word) >= 0) continue;
    if (node.is_table() || node.is_array_of_tables()) {
      errors.at_table(node, "[" + word + "]", "unknown section", remedy_for_unknown(word, known));
    } else {
      errors.at(node, word, "stands outside every section",
                "move it below the section that it belongs to; sections: " + join(known));
    }
  }
}

void read_robot(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  SectionReader section(errors, "robot", "robot", section_table(errors, root, "robot"));
  if (const auto name = section.text("name")) robot.name = *name;
  if (const auto seed = section.count("seed")) robot.config.seed = static_cast<std::uint64_t>(*seed);
  section.refuse_unknown();
}

/// The model and the cost that its file exports; null: without it, the names that all else refers to are unknown.
const tiller_model_t* read_model(FileErrors& errors, const toml::table& root, ModelRequest& request,
                                 const tiller_own_cost_t*& own_cost) {
  const toml::table* table = section_table(errors, root, "model");
  SectionReader section(errors, "model", "model", table);
  const std::size_t before = errors.list().size();
  request.name = section.text("name").value_or("");
  request.file = section.text("file").value_or("");
  request.type = section.text("type").value_or("");
  request.cost_type = section.text("cost_type").value_or("");
  section.refuse_unknown();
  if (!section.has("name") && !section.has("file")) {
    section.missing("name", "write name = one of: " + join(builtin_model_names()) +
                                "; or file = \"my_model.hpp\" with type = \"MyModel\"");
    return nullptr;
  }
  if (errors.list().size() != before && (request.name + request.file).empty()) {
    return nullptr;
  }
  std::string problem;
  if (const tiller_model_t* model = load_model(request, problem, &own_cost)) return model;
  const std::string key = section.has("name") ? "name" : "file";
  const std::string near = nearest(request.name, builtin_model_names());
  section.error(
      key, problem,
      near.empty() || near == request.name ? "see docs/reference/robot_file.md" : "did you mean " + near + "?");
  return nullptr;
}

void take_names(const tiller_model_t& model, RobotNames& names) {
  names.states.assign(model.state_names, model.state_names + model.state_count);
  names.outputs.assign(model.output_names, model.output_names + model.output_count);
  names.inputs.assign(model.input_names, model.input_names + model.input_count);
  names.params.assign(model.param_names, model.param_names + model.param_count);
}

void read_bound_sections(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  for (const char* name : {"body", "noise", "start", "posterior", "planner", "probe", "cost", "safety", "recorder"}) {
    SectionReader section(errors, name, name, section_table(errors, root, name));
    section.read_bound(robot.config, robot.names.states, robot.names.inputs);
    if (std::string(name) == "safety") read_hold_gain(section, robot);
    if (std::string(name) == "probe") read_probe(section, robot);
    if (std::string(name) == "posterior") {
      choose_discrepancy(section, robot);
      read_forgetting(section, robot);
      read_drift(section, robot);
      read_prior_file(section, robot);
    }
    section.refuse_unknown();
  }
  SectionReader model(errors, "model", "model", root["model"].as_table());
  model.read_bound(robot.config, robot.names.states, robot.names.inputs);
}

/// The defaults serve every kind of planner. `mppi` finds more with as many rollouts a tick in twice the iterations
/// (docs/evidence/planners.md); who states one of the four keys has chosen the others beside it.
void choose_sampling(const toml::table& root, tiller_planner_config_t& planner) {
  const auto planner_keys = root["planner"];
  for (const char* key : {"knots", "rollouts", "iterations", "temperature"})
    if (planner_keys[key]) return;
  if (planner.kind != tiller_planner_mppi) return;
  planner.knots = std::min(std::uint32_t{6}, planner.horizon);
  planner.rollouts = 128;
  planner.iterations = 4;
  planner.temperature = 0.02;
}

void read_sections(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const tiller_own_cost_t* own_cost = nullptr;
  const tiller_model_t* model = read_model(errors, root, robot.model_request, own_cost);
  if (!model) return;
  const tiller_status_t status = tiller_config_default(&robot.config, model);
  if (status != tiller_status_ok)
    return errors.at_line(1, "model", tiller_status_text(status), "correct the model's table");
  robot.config.cost.own = own_cost;
  take_names(*model, robot.names);
  read_robot(errors, root, robot);
  read_effects(errors, root, robot);  // before the parameters: both fill `priors`, the model's come first
  read_parameters(errors, root, robot);
  read_networks(errors, root, robot);  // a policy may read the parameters that have priors
  read_measurements(errors, root, robot);
  read_bound_sections(errors, root, robot);
  choose_sampling(root, robot.config.planner);
  // a slow machine's measurements are not late because they are a period old
  constexpr double kPeriodsToLate = 5;
  if (!root["safety"]["sensor_timeout_s"] && robot.config.period_s > robot.config.safety.sensor_timeout_s)
    robot.config.safety.sensor_timeout_s = kPeriodsToLate * robot.config.period_s;
  read_cost_terms(errors, root, robot);
  read_limits(errors, root, robot);
  read_cones(errors, root, robot);
  read_transport(errors, root, robot);
  read_realtime(errors, root, robot);
  read_sim(errors, root, robot);
  read_log_map(errors, root, robot);
  read_figure(errors, root, robot);
  if (errors.empty()) check_whole(errors, root, robot);
  if (errors.empty()) check_start(errors, root, robot);
}

}  // namespace

int index_of(const Words& names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

RobotText parse_robot_text(const std::string& text, const std::string& path, std::string& errors_out) {
  FileErrors errors(path, text);
  RobotText read;
  read.robot = std::make_unique<RobotFile>();
  RobotFile& robot = *read.robot;
  robot.path = path;
  robot.name = std::filesystem::path(path).stem().string();
  robot.model_request.robot_dir = std::filesystem::path(path).parent_path().string();
  try {
    const toml::table root = toml::parse(std::string_view(text), std::string_view(path));
    read.says_substeps = static_cast<bool>(root["model"]["substeps"]);
    read.says_horizon = static_cast<bool>(root["planner"]["horizon"]);
    refuse_unknown_sections(errors, root);
    read_sections(errors, root, robot);
  } catch (const toml::parse_error& error) {
    errors.at_line(static_cast<int>(error.source().begin.line), "TOML", std::string(error.description()),
                   "correct the syntax (toml.io)");
  }
  if (errors.empty()) return read;
  errors_out = errors.text();
  return {};
}

}  // namespace tiller::tools
