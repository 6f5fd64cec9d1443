#include "tools/robot/robot_file.hpp"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>

#include "posterior/posterior.hpp"
#include "rollout/attitude.hpp"
#include "rollout/measurement.hpp"
#include "tools/robot/config_trace.hpp"
#include "tools/robot/network_file.hpp"
#include "tools/robot/robot_equations.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/robot_text.hpp"

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

/// Whether the model is there; without it, the names that everything else refers to are unknown.
bool read_model(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "model");
  SectionReader section(errors, "model", "model", table);
  const std::size_t before = errors.list().size();
  robot.model_request.name = section.text("name").value_or("");
  robot.model_request.file = section.text("file").value_or("");
  robot.model_request.type = section.text("type").value_or("");
  robot.model_request.cost_type = section.text("cost_type").value_or("");
  section.refuse_unknown();
  if (!section.has("name") && !section.has("file")) {
    section.missing("name", "write name = one of: " + join(builtin_model_names()) +
                                "; or file = \"my_model.hpp\" with type = \"MyModel\"");
    return false;
  }
  if (errors.list().size() != before && (robot.model_request.name + robot.model_request.file).empty()) {
    return false;
  }
  std::string problem;
  robot.model = load_model(robot.model_request, problem, &robot.own_cost);
  if (robot.model) return true;
  const std::string key = section.has("name") ? "name" : "file";
  const std::string near = nearest(robot.model_request.name, builtin_model_names());
  section.error(key, problem,
                near.empty() || near == robot.model_request.name ? "see docs/reference/robot_file.md"
                                                                 : "did you mean " + near + "?");
  return false;
}

void take_names(RobotFile& robot) {
  const tiller_model_t& model = *robot.model;
  robot.states.assign(model.state_names, model.state_names + model.state_count);
  robot.outputs.assign(model.output_names, model.output_names + model.output_count);
  robot.inputs.assign(model.input_names, model.input_names + model.input_count);
  robot.params.assign(model.param_names, model.param_names + model.param_count);
}

void read_bound_sections(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  for (const char* name : {"body", "noise", "start", "posterior", "planner", "cost", "safety", "recorder"}) {
    SectionReader section(errors, name, name, section_table(errors, root, name));
    section.read_bound(robot.config, robot.states, robot.inputs);
    if (std::string(name) == "safety") read_hold_gain(section, robot);
    if (std::string(name) == "posterior") {
      choose_discrepancy(section, robot);
      read_forgetting(section, robot);
      read_drift(section, robot);
      read_prior_file(section, robot);
    }
    section.refuse_unknown();
  }
  SectionReader model(errors, "model", "model", root["model"].as_table());
  model.read_bound(robot.config, robot.states, robot.inputs);
}

/// Step by step into the file, as far as the path goes there: keys that are left out have defaults.
const toml::node* find_node(const toml::table& root, const Words& path, std::string& found) {
  const toml::node* node = &root;
  for (const std::string& step : path) {
    const toml::node* next = nullptr;
    if (const toml::table* table = node->as_table()) next = table->get(step);
    if (const toml::array* list = node->as_array()) next = list->get(std::stoul(step));
    if (!next) break;
    node = next;
    const bool element = node->is_table() && std::isdigit(static_cast<unsigned char>(step[0]));
    found += element ? "[" + std::to_string(std::stoul(step) + 1) + "]" : (found.empty() ? "" : ".") + step;
  }
  return node == &root ? nullptr : node;
}

std::string remedy_for(const Words& path) {
  const KeySpec* spec = path.size() > 1 ? find_key(path[0], path[1]) : nullptr;
  return (spec ? std::string(spec->help) + "; " : std::string()) + "see `tiller help robot-file`";
}

/// Demands of a posterior's engine on the rest of the file; empty where the field is a setting of its own.
std::string engine_wants(const RobotFile& robot, const std::string& field) {
  if (field == "measurement" || field == "measured_state") {
    Words missing;
    for (const std::string& state : robot.states)
      if (std::find(robot.measurements.begin(), robot.measurements.end(), state) == robot.measurements.end())
        missing.push_back(state);
    return "wants every state measured; [measurement] lacks " + join(missing, ", ");
  }
  if (field == "effects") return "takes no effect with a state of its own, such as actuator_lag";
  if (field == "posterior.kind" && robot.config.posterior.kind == tiller_posterior_conjugate)
    return "wants a step that is affine in the parameters that have priors";
  if (field == "model") return "wants a model whose kernels take residuals";
  if (field.compare(0, 6, "priors") == 0) return "wants normal priors without bounds";
  return {};
}

/// What is wrong, and what to do about it.
struct Refusal {
  std::string problem, remedy;
};

/// What quaternions among the states demand (docs/reference/rotations.md); empty where the field is none of theirs.
Refusal attitude_wants(const RobotFile& robot, const std::string& field) {
  const tiller_config_t& c = robot.config;
  const auto about = [&](const char* name) { return field.compare(0, std::strlen(name), name) == 0; };
  Refusal told;
  const auto of_state = [&](std::uint32_t first) {
    const auto all = [&](std::uint32_t from) {
      return join(Words(robot.states.begin() + from, robot.states.begin() + first + 4), ", ");
    };
    const std::string index = "[" + std::to_string(first) + "]";
    const std::size_t length = index.size();
    const bool named = field.size() > length && field.compare(field.size() - length, length, index) == 0;
    if ((about("cost.target") || about("initial_state")) && named)
      told = {"the quaternion " + all(first) + " is not of length 1",
              "write all four of it; 1, 0, 0, 0 is no rotation"};
    if ((about("cost.state_weight") || about("cost.terminal_weight")) && named)
      told = {"the first of a quaternion bears no weight",
              "write weights for " + all(first + 1) + ": rotations about the body's axes in half radians"};
    if (about("cost.reference"))
      told = {"has a row in which the quaternion " + all(first) + " is not of length 1",
              "divide the four by their length"};
    if (about("measured_state"))
      told = {"a quaternion is measured whole or not at all",
              "write " + all(first) + " in this order into [measurement], one after the other, or none of them"};
  };
  for_quaternions(c.model->quaternion_mask, of_state);
  if (c.model->quaternion_mask == 0) return told;
  if (about("planner.kind") && c.planner.kind == tiller_planner_sqp)
    told = {"does not plan for a quaternion among the states", "write ilqr, hybrid or mppi"};
  if (about("posterior.kind") && c.posterior.kind != tiller_posterior_filter)
    told = {"takes no quaternion among the states", "kind = \"filter\" does"};
  if (about("cost.demonstration_weight"))
    told = {"demonstrations of a quaternion among the states are not known", "write a reference"};
  if (about("cost.demonstration_divergence"))
    told = {"covariances of a quaternion among the states are not predicted", "leave it out"};
  return told;
}

/// What does not go with a tree of scenarios; empty where the field is none of its.
Refusal tree_wants(const RobotFile& robot, const std::string& field) {
  const tiller_planner_config_t& p = robot.config.planner;
  if (field != "planner.qp_solver" || p.closed_loop == 0 || p.kind != tiller_planner_sqp) return {};
  return {"\"osqp\" solves no trees of scenarios, and closed_loop = true plans on one",
          "write qp_solver = \"riccati\", or closed_loop = false"};
}

/// A measurement is not late before the next one is due: a period in milliseconds is the likely mistake.
Refusal timeout_wants(const RobotFile& robot, const std::string& field) {
  const double period = robot.config.period_s, timeout = robot.config.safety.sensor_timeout_s;
  if (field != "safety.sensor_timeout_s" || !(timeout < period)) return {};
  return {number_text(timeout) + " s is below the control period of " + number_text(period) + " s",
          period < 1.0
              ? "write period_s at least"
              : "if " + number_text(period) + " ms is meant, write [model] period_s = " + number_text(1e-3 * period)};
}

/// A contact is felt by a posterior that estimates forces, at the joints that it estimates them of.
Refusal contact_wants(const RobotFile& robot, const std::string& field) {
  if (field.compare(0, std::strlen("safety.contact_force"), "safety.contact_force") != 0) return {};
  const tiller_config_t& c = robot.config;
  const std::uint32_t joints = Posterior::force_joints(c);
  if (joints == 0)
    return {"nothing estimates the forces at the joints",
            "write [posterior] disturbance = true, with kind = \"filter\""};
  Words felt;
  for (std::uint32_t j = 0; j < joints; ++j) felt.push_back(robot.states[c.model->joints[j].velocity]);
  return {"no force is estimated there", "forces are felt at " + join(felt, ", ")};
}

/// What an engine does not estimate beside the parameters as they are.
Refusal lacking_wants(const RobotFile& robot, const std::string& field) {
  const tiller_posterior_config_t& p = robot.config.posterior;
  const std::string engine = std::string("the engine ") + posterior_names()[p.kind];
  if (field == "posterior.disturbance")
    return {engine + " estimates no forces beyond the model", "write kind = \"filter\", or leave it out"};
  if (field != "posterior.drift") return {};
  if (p.kind != tiller_posterior_filter)
    return {engine + " lets no parameter drift", "write kind = \"filter\", or leave it out"};
  return {"names more parameters than can drift, or one that only says how a sensor reads",
          "name " + std::to_string(TILLER_MAX_DRIFTS) + " at most, of the model or of its forces"};
}

/// Errors that only the library's own check sees: multiples, and combinations of values.
void check_whole(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const char* field = nullptr;
  const tiller_status_t status = tiller_config_check(&robot.config, &field);
  if (status == tiller_status_ok) return;
  std::string wants;
  if (status == tiller_status_bad_posterior && attitude_wants(robot, field ? field : "").problem.empty())
    wants = engine_wants(robot, field ? field : "");
  if (status == tiller_status_bad_effect && has_sensor_effects(robot.config) &&
      robot.config.posterior.kind != tiller_posterior_filter)
    wants = "takes measurements for the states themselves and so no effect at a sensor, such as sensor_bias";
  if (!wants.empty()) {
    const toml::node* kind = root["posterior"]["kind"].node();
    const std::string name = posterior_names()[robot.config.posterior.kind];
    const std::string problem = "the engine " + name + " " + wants;
    if (kind) return errors.at(*kind, "posterior.kind", problem, "kind = \"filter\" takes any");
  }
  const Words path = trace_field(robot, field ? field : "");
  std::string found;
  const toml::node* node = find_node(root, path, found);
  const std::string key = join(path, ".");
  Refusal told = attitude_wants(robot, field ? field : "");
  if (told.problem.empty()) told = tree_wants(robot, field ? field : "");
  if (told.problem.empty()) told = timeout_wants(robot, field ? field : "");
  if (told.problem.empty()) told = contact_wants(robot, field ? field : "");
  if (told.problem.empty()) told = lacking_wants(robot, field ? field : "");
  if (told.problem.empty()) told = {tiller_status_text(status), remedy_for(path)};
  if (!node) {
    errors.at_line(errors.last_line(), key, told.problem, told.remedy);
  } else if (node->is_table() && !node->as_table()->is_inline()) {
    errors.at_table(*node, key, told.problem, told.remedy);
  } else {
    errors.at(*node, found, told.problem, told.remedy);
  }
}

bool read_controller(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  if (!read_model(errors, root, robot)) return false;
  const tiller_status_t status = tiller_config_default(&robot.config, robot.model);
  if (status != tiller_status_ok) {
    errors.at_line(1, "model", tiller_status_text(status), "correct the model's table");
    return false;
  }
  take_names(robot);
  read_robot(errors, root, robot);
  read_effects(errors, root, robot);  // before the parameters: both fill `priors`, the model's come first
  read_parameters(errors, root, robot);
  read_networks(errors, root, robot);  // a policy may read the parameters that have priors
  read_measurements(errors, root, robot);
  read_bound_sections(errors, root, robot);
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
  return errors.empty();
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
    read_controller(errors, root, robot);
  } catch (const toml::parse_error& error) {
    errors.at_line(static_cast<int>(error.source().begin.line), "TOML", std::string(error.description()),
                   "correct the syntax (toml.io)");
  }
  if (errors.empty()) return read;
  errors_out = errors.text();
  return {};
}

}  // namespace tiller::tools
