// What the library's own check refuses in a robot file, told with its line and a remedy.

#include <algorithm>
#include <cctype>
#include <cstring>

#include "posterior/posterior.hpp"
#include "rollout/attitude.hpp"
#include "rollout/measurement.hpp"
#include "tools/robot/config_trace.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

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
    for (const std::string& state : robot.names.states)
      if (std::find(robot.names.measurements.begin(), robot.names.measurements.end(), state) ==
          robot.names.measurements.end())
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
      return join(Words(robot.names.states.begin() + from, robot.names.states.begin() + first + 4), ", ");
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
  for (std::uint32_t j = 0; j < joints; ++j) felt.push_back(robot.names.states[c.model->joints[j].velocity]);
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

}  // namespace

void check_whole(FileErrors& errors, const toml::table& root, const RobotFile& robot) {
  const char* at = nullptr;
  const tiller_status_t status = tiller_config_check(&robot.config, &at);
  if (status == tiller_status_ok) return;
  const std::string field = at ? at : "";
  std::string wants;
  if (status == tiller_status_bad_posterior && attitude_wants(robot, field).problem.empty())
    wants = engine_wants(robot, field);
  if (status == tiller_status_bad_effect && has_sensor_effects(robot.config) &&
      robot.config.posterior.kind != tiller_posterior_filter)
    wants = "takes measurements for the states themselves and so no effect at a sensor, such as sensor_bias";
  if (!wants.empty()) {
    const toml::node* kind = root["posterior"]["kind"].node();
    const std::string name = posterior_names()[robot.config.posterior.kind];
    const std::string problem = "the engine " + name + " " + wants;
    if (kind) return errors.at(*kind, "posterior.kind", problem, "kind = \"filter\" takes any");
  }
  const Words path = trace_field(robot, field);
  std::string found;
  const toml::node* node = find_node(root, path, found);
  const std::string key = join(path, ".");
  Refusal told;
  for (const auto wants_of : {attitude_wants, tree_wants, timeout_wants, contact_wants, lacking_wants})
    if (told.problem.empty()) told = wants_of(robot, field);
  if (told.problem.empty()) told = {tiller_status_text(status), remedy_for(path)};
  if (!node) {
    errors.at_line(errors.last_line(), key, told.problem, told.remedy);
  } else if (node->is_table() && !node->as_table()->is_inline()) {
    errors.at_table(*node, key, told.problem, told.remedy);
  } else {
    errors.at(*node, found, told.problem, told.remedy);
  }
}

}  // namespace tiller::tools
