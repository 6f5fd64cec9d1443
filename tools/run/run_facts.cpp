#include "tools/run/run_facts.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "costs/cost_term_info.hpp"
#include "posterior/posterior.hpp"
#include "posterior/prior.hpp"
#include "tools/base/frame_names.hpp"
#include "tools/logs/frame_forces.hpp"
#include "tools/robot/prior_edge.hpp"
#include "tools/robot/robot_schema.hpp"
#include "tools/robot/units.hpp"
#include "tools/run/foresight.hpp"
#include "tools/run/friction_text.hpp"
#include "tools/run/run_summary.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

/// 5 % and 95 % of the prior.
Json prior_range(const tiller_prior_t& p) {
  return Json::array({from_coordinate(p, prior_quantile(p, 0.05)), from_coordinate(p, prior_quantile(p, 0.95))});
}

std::string adequacy_text(const RobotFile& robot, const RunResult& result) {
  const tiller_info_t& info = result.info;
  if (info.adequacy == tiller_adequacy_untested) return "not tested";
  if (info.adequacy == tiller_adequacy_adequate) return "adequate";
  const std::string force = systematic_force_text(robot, info);
  return format("%.2f s: ", result.inadequate_at_s) + robot.names.measurements[info.inadequate_channel] + ", " +
         tiller_feature_name(static_cast<tiller_feature_t>(info.inadequate_feature)) +
         (force.empty() ? "" : ": " + force);
}

Json facts(const RobotFile& robot, const RunResult& result) {
  const tiller_config_t& c = robot.config;
  Json all = {{"robot file", std::filesystem::path(robot.path).filename().string()},
              {"model", robot.config.model->name},
              {"planner", planner_names()[c.planner.kind]},
              {"posterior", c.posterior.enabled ? std::to_string(c.posterior.particles) + " particles" : "frozen"},
              {"period", number_text(1000 * c.period_s) + " ms"},
              {"seed", std::to_string(c.seed)},
              {"tick, median", format("%.2f ms", result.pace.tick_time.quantile_us(0.5) / 1000)},
              {"tick, 99 %", format("%.2f ms", result.pace.tick_time.quantile_us(0.99) / 1000)},
              {"ended in", tiller_state_name(static_cast<tiller_state_t>(result.info.state))},
              {"adequacy", adequacy_text(robot, result)},
              {"logs", log_text(result.log)},
              {"lanes", tiller_instruction_set()}};
  if (const std::string probing = probing_text(result.info); !probing.empty()) all["probing"] = probing;
  for (const std::string& line : friction_lines(robot, result.info)) {
    const std::size_t comma = line.find(", ");
    all[line.substr(0, comma)] = line.substr(comma + 2);
  }
  return all;
}

Json with_units(const Words& names, const Words& units) {
  Json object = Json::object();
  for (std::size_t i = 0; i < names.size(); ++i) object[names[i]] = units[i];
  return object;
}

Json with_units(const Words& names) {
  Words units;
  for (const std::string& name : names) units.push_back(unit_of_field(name));
  return with_units(names, units);
}

bool is_weighed(const tiller_cost_config_t& cost, std::size_t state) {
  return cost.state_weight[state] > 0 || cost.terminal_weight[state] > 0 ||
         (cost.saturating_weight > 0 && std::isfinite(cost.saturating_width[state]));
}

/// The two states that span the plane which the robot moves in, and what stands there: those of the obstacles, else the
/// only two that are in metres, else x_m and y_m. Null: it moves in none.
Json plane_of(const RobotFile& robot) {
  const tiller_cost_config_t& cost = robot.config.cost;
  std::vector<std::size_t> axes;
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)
    if (unit_of_field(robot.names.states[i]) == "m") axes.push_back(i);
  const auto is_circle = [](const tiller_cost_term_t& term) { return cost_term_info(term.kind).circle; };
  const tiller_cost_term_t* const end = cost.terms + cost.term_count;
  const tiller_cost_term_t* const first = std::find_if(cost.terms, end, is_circle);
  if (first != end) axes = {first->states[0], first->states[1]};
  if (axes.size() != 2) {
    axes.clear();
    for (const char* name : {"x_m", "y_m"})
      for (std::size_t i = 0; i < robot.names.states.size(); ++i)
        if (robot.names.states[i] == name) axes.push_back(i);
  }
  if (axes.size() != 2) return nullptr;
  Json plane = {{"x", robot.names.states[axes[0]]}, {"y", robot.names.states[axes[1]]}, {"obstacles", Json::array()}};
  for (const tiller_cost_term_t* o = first; o != end; ++o)
    if (is_circle(*o) && o->states[0] == axes[0] && o->states[1] == axes[1])
      plane["obstacles"].push_back(Json::array({o->params[0], o->params[1], o->params[2]}));
  return plane;
}

/// Meaning of each column of the log: a reader that told commands from counters by their names would draw the counters
/// that a later version adds.
Json columns(const RobotFile& robot) {
  const Words all = parameter_units(robot.config, robot.names.params);
  Words inferred, units;
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    inferred.push_back(robot.names.params[i]);
    units.push_back(all[i]);
  }
  Words angles;
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)
    if ((robot.config.model->angle_mask >> i & 1u) != 0) angles.push_back(robot.names.states[i]);
  Words tracked;
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)
    if (robot.config.cost.reference && is_weighed(robot.config.cost, i)) tracked.push_back(robot.names.states[i]);
  return {{"states", with_units(robot.names.states)},  {"angles", angles},
          {"measured", robot.names.measurements},      {"inputs", with_units(robot.names.inputs)},
          {"parameters", with_units(inferred, units)}, {"tracked", tracked}};
}

/// Outputs that have a cost, and the frames that are wanted somewhere, whose rotation is no nine curves.
void add_outputs(const RobotFile& robot, Json& json) {
  const tiller_cost_config_t& c = robot.config.cost;
  Json outputs = Json::object(), frames = Json::array(), target = Json::object();
  const auto weighed = [&](const std::string& name) {
    const int at = index_of(robot.names.outputs, name);
    return at >= 0 && (c.outputs[at].weight > 0 || c.outputs[at].terminal_weight > 0 || c.outputs[at].bound_weight > 0);
  };
  // of pairs of spheres the page shows the nearest alone
  Json clearance = Json::object(), bounds = Json::object();
  if (robot.memory.rows)
    for (const ClearanceOutput& pair : robot.memory.rows->clearance)
      clearance[pair.output] = {{"radii_m", pair.radii_m}, {"margin_m", pair.margin_m}};
  const auto bounds_of = [](const tiller_output_cost_t& o) {
    return Json::array({std::isfinite(o.low) ? Json(o.low) : Json(), std::isfinite(o.high) ? Json(o.high) : Json()});
  };
  std::set<std::string> rotations;
  for (const std::string& output : robot.names.outputs) {
    if (output.size() < 5 || output.compare(output.size() - 4, 4, "_x_m") != 0) continue;
    const std::string frame = output.substr(0, output.size() - 4);
    const auto names = frame_output_names(frame);
    if (index_of(robot.names.outputs, names.back()) < 0) continue;
    rotations.insert(names.begin() + 3, names.end());
    if (weighed(names[0]) || weighed(names[3]))
      frames.push_back({{"name", frame}, {"moves", weighed(names[0])}, {"turns", weighed(names[3])}});
  }
  for (std::size_t j = 0; j < robot.names.outputs.size(); ++j) {
    const std::string& name = robot.names.outputs[j];
    target[name] = c.outputs[j].target;
    if (!weighed(name) || rotations.count(name) > 0 || clearance.contains(name)) continue;
    outputs[name] = unit_of_field(name);
    if (!(c.outputs[j].weight > 0) && !(c.outputs[j].terminal_weight > 0)) bounds[name] = bounds_of(c.outputs[j]);
  }
  if (!clearance.empty()) json["clearance"] = clearance;
  if (!bounds.empty()) json["output_bounds"] = bounds;
  json["columns"]["outputs"] = outputs;
  json["columns"]["frames"] = frames;
  json["output_target"] = target;
}

Json value_json(const FigureValue& value) {
  Json terms = Json::array();
  for (const FigureTerm& term : value) terms.push_back(Json::array({term.factor, term.name}));
  return terms;
}

template <class Values>
Json values_json(const Values& values) {
  Json list = Json::array();
  for (const FigureValue& value : values) list.push_back(value_json(value));
  return list;
}

Json link_json(const FigureLink& link) {
  Json json = {{"name", link.name},
               {"parent", link.parent},
               {"position_m", values_json(link.position_m)},
               {"rpy_rad", values_json(link.rpy_rad)},
               {"axis", link.axis},
               {"turn_rad", value_json(link.turn_rad)},
               {"slide_m", value_json(link.slide_m)},
               {"joined", link.joined}};
  if (!link.quaternion.empty()) json["quaternion"] = values_json(link.quaternion);
  json["lines_m"] = json["circles"] = json["boxes"] = Json::array();
  for (const auto& line : link.lines_m) {
    Json points = Json::array();
    for (const FigurePoint& point : line) points.push_back(values_json(point));
    json["lines_m"].push_back(points);
  }
  for (const FigureCircle& circle : link.circles)
    json["circles"].push_back(
        {{"at_m", values_json(circle.at_m)}, {"radius_m", value_json(circle.radius_m)}, {"normal", circle.normal}});
  for (const FigureBox& box : link.boxes)
    json["boxes"].push_back({{"at_m", values_json(box.at_m)}, {"size_m", values_json(box.size_m)}});
  return json;
}

/// The figure, and the parameters that it may name: what the controller believes where the log has no column, and the
/// plant's.
void add_figure(const RobotFile& robot, const std::vector<double>& true_params, Json& json) {
  if (robot.figure.line == 0) return;
  Json figure = {{"view", robot.figure.view}, {"goals_m", Json::array()}, {"links", Json::array()}};
  for (const FigurePoint& goal : robot.figure.goals_m) figure["goals_m"].push_back(values_json(goal));
  for (const FigureLink& link : robot.figure.links) figure["links"].push_back(link_json(link));
  figure["parameters"] = figure["true_parameters"] = Json::object();
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed)
      figure["parameters"][robot.names.params[i]] = robot.config.priors[i].a;
    if (i < true_params.size() && std::isfinite(true_params[i]))
      figure["true_parameters"][robot.names.params[i]] = true_params[i];
  }
  json["figure"] = figure;
}

}  // namespace

std::string run_facts_json(const RobotFile& robot, const RunResult& result, const RunStory& story) {
  const tiller_config_t& c = robot.config;
  Json json = {{"title", story.title}, {"good", story.good}};
  if (!story.outcome.empty()) json["outcome"] = story.outcome;
  json["columns"] = columns(robot);
  if (c.cost.outputs) add_outputs(robot, json);
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i) {
    json["limits"][robot.names.inputs[i]] = Json::array({c.safety.input_low[i], c.safety.input_high[i]});
  }
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)  // of a reference the log has the rows
    if (!c.cost.reference && is_weighed(c.cost, i)) json["target"][robot.names.states[i]] = c.cost.target[i];
  for (std::uint32_t j = 0; j < Posterior::force_joints(c); ++j) {
    const tiller_joint_t& joint = c.model->joints[j];
    const std::string name = c.model->force_names[joint.force];
    json["columns"]["forces"][name] = unit_of_field(name);
    if (const double limit = c.safety.contact_force[joint.velocity]; std::isfinite(limit))
      json["contacts"][name] = limit;
  }
  const FrameForces frames(c);
  for (const std::string& name : frames.names()) json["columns"]["forces"][name] = unit_of_field(name);
  if (const Json plane = plane_of(robot); !plane.is_null()) json["plane"] = plane;
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    if (c.priors[i].kind != tiller_prior_fixed) json["priors"][robot.names.params[i]] = prior_range(c.priors[i]);
  }
  const std::vector<PriorEdge> edges = find_prior_edges(robot.config, robot.names.params, result.particles);
  for (std::size_t i = 0; i < edges.size() && c.posterior.enabled; ++i)
    if (edges[i].side != EdgeSide::none)
      json["edges"][robot.names.params[i]] = edge_json(robot.names.params[i], edges[i]);
  for (std::size_t i = 0; i < story.sd_without_probing.size(); ++i)
    if (c.priors[i].kind != tiller_prior_fixed)
      json["sd_without_probing"][robot.names.params[i]] = story.sd_without_probing[i];
  if (c.planner.predict_spread != 0) json["foreseen_s"] = Foresight::steps_ahead(c.planner.horizon) * c.period_s;
  json["facts"] = facts(robot, result);
  add_figure(robot, story.true_params, json);
  return json.dump(2) + "\n";
}

bool write_run_facts(const RobotFile& robot, const RunResult& result, const RunStory& story, std::string& error) {
  const std::string path = std::filesystem::path(result.files.readable_log).replace_extension(".json").string();
  std::ofstream file(path);
  file << run_facts_json(robot, result, story);
  file.close();
  if (file) return true;
  error = path + ": cannot be written";
  return false;
}

}  // namespace tiller::tools
