// [cost]: what is more than keys with a place in the configuration: bounds, terms of costs.def, trajectories, a cost
// of one's own.

#include <cmath>
#include <filesystem>

#include "costs/cost_term_info.hpp"
#include "tiller/config.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/trajectory_file.hpp"

namespace tiller::tools {
namespace {

void read_bound_of(FileErrors& errors, const std::string& name, const toml::node& node, std::size_t state,
                   RobotFile& robot) {
  Config& config = robot.config;
  SectionReader bound(errors, "cost.bounds.*", "cost.bounds." + name, node.as_table());
  const std::size_t before = errors.list().size();
  bound.refuse_unknown();
  const auto low = bound.number("low");
  const auto high = bound.number("high");
  const double margin = bound.number("margin").value_or(0.0);
  const auto weight = bound.number("weight");
  const auto hard = bound.flag("hard");
  if (errors.list().size() != before) return;
  if (!low && !high) {
    bound.missing("low", "write low, high, or both");
  } else if (bound.in_order("low", low, "high", high) && weight.value_or(0) <= 0 && !hard.value_or(false)) {
    bound.missing("weight", "write weight = what being outside costs, or hard = true with the planner sqp");
  }
  if (low && high && !(*low + margin < *high - margin) && *low < *high)
    bound.error("margin", "leaves nothing between low and high", "write less than half of their distance");
  if (low) config.state_low[state] = *low + margin;
  if (high) config.state_high[state] = *high - margin;
  config.bound_weight[state] = weight.value_or(0);
  if (hard.value_or(false)) config.cost.hard_bounds |= 1u << state;
}

void read_bounds(SectionReader& section, RobotFile& robot) {
  const toml::table* table = section.subtable("bounds");
  if (!table) return;
  for (const Entry& entry : in_file_order(*table)) {
    const std::string path = section.path_of("bounds." + entry.name);
    const int state = index_of(robot.names.states, entry.name);
    if (state < 0) {
      section.errors().at(*entry.node, path, "the model has no state of that name",
                          remedy_for_unknown(entry.name, robot.names.states));
    } else if (!entry.node->is_table()) {
      section.errors().at(*entry.node, path, "is " + kind_text(*entry.node),
                          "write { low = .., high = .., weight = .. }");
    } else {
      read_bound_of(section.errors(), entry.name, *entry.node, static_cast<std::size_t>(state), robot);
    }
  }
}

/// The index of the state that a key names; -1 after an error.
int named_state(SectionReader& section, const char* key, const Words& states) {
  if (!section.has(key)) section.missing(key, "write the state that is meant: " + join(states));
  const auto name = section.text(key);
  const int state = name ? index_of(states, *name) : -1;
  if (name && state < 0) section.error(key, "the model has no state of that name", remedy_for_unknown(*name, states));
  return state;
}

/// One of [[cost.<key>]], as its kind in costs.def says.
void read_term(FileErrors& errors, const toml::table& table, std::uint32_t kind, std::size_t index, RobotFile& robot) {
  const CostTermInfo& info = cost_term_info(kind);
  const std::string key = std::string("cost.") + cost_term_key(kind);
  SectionReader section(errors, key + "[]", key + "[" + std::to_string(index) + "]", &table);
  const std::size_t before = errors.list().size();
  section.refuse_unknown();
  tiller_cost_term_t term = {};
  term.kind = kind;
  const auto number = [&](const char* name) {
    if (!section.has(name)) section.missing(name, find_key(key + "[]", name)->help);
    return section.number(name).value_or(1.0);
  };
  for (std::uint32_t i = 0; i < info.state_count; ++i) {
    const int state = named_state(section, info.states[i].key, robot.names.states);
    term.states[i] = static_cast<std::uint32_t>(state);  // of one that is not found: no other's
    for (std::uint32_t j = 0; j < i; ++j)
      if (state >= 0 && term.states[j] == term.states[i])
        section.error(info.states[i].key, "is " + std::string(info.states[j].key) + " already", "name another state");
  }
  for (std::uint32_t i = 0; i < info.param_count; ++i) term.params[i] = number(info.params[i].key);
  term.weight = number("weight");
  if (errors.list().size() != before) return;
  std::uint32_t& count = robot.config.cost.term_count;
  if (count < TILLER_MAX_COST_TERMS) {
    robot.config.terms[count++] = term;
  } else {
    errors.at_table(table, key, "there are more than " + std::to_string(count) + " terms of [[cost. ]] in all",
                    "keep at most " + std::to_string(TILLER_MAX_COST_TERMS));
  }
}

void read_catalogue_terms(SectionReader& section, std::uint32_t kind, RobotFile& robot) {
  const std::string key = cost_term_key(kind), path = "cost." + key;
  const toml::node* node = section.node(key);
  if (!node) return;
  const std::string remedy = std::string("head each ") + cost_term_info(kind).name + " with [[" + path + "]]";
  const toml::array* list = node->as_array();
  if (!list) {
    section.error(key, "is " + kind_text(*node), remedy);
    return;
  }
  std::size_t index = 0;
  for (const toml::node& element : *list) {
    if (const toml::table* table = element.as_table())
      read_term(section.errors(), *table, kind, ++index, robot);
    else
      section.errors().at(element, path, "is " + kind_text(element), remedy);
  }
}

/// A trajectory of the file that `node` names; what is wrong with it stands behind the node's line.
bool read_rows(FileErrors& errors, const toml::node& node, const std::string& key, const RobotFile& robot,
               Trajectory& out) {
  if (!node.is_string() || node.value<std::string>()->empty()) {
    errors.at(node, key, "is " + kind_text(node), "write the name of a CSV file in quotes");
    return false;
  }
  const std::filesystem::path file = *node.value<std::string>();
  const std::filesystem::path path = file.is_absolute() ? file : robot.model_request.robot_dir / file;
  Words problems;
  if (read_trajectory(path.string(), *robot.config.model, robot.config.period_s, out, problems)) return true;
  for (const std::string& problem : problems) {
    const std::size_t remedy = problem.rfind("; ");
    errors.at(node, key, problem.substr(0, remedy), problem.substr(remedy + 2));
  }
  return false;
}

void read_reference(SectionReader& section, RobotFile& robot, TaskRows& rows) {
  const toml::node* node = section.node("reference");
  Trajectory trajectory;
  if (!node || !read_rows(section.errors(), *node, "cost.reference", robot, trajectory)) return;
  rows.reference = std::move(trajectory.mean);
  robot.config.cost.reference = rows.reference.data();
  robot.config.cost.reference_steps = static_cast<std::uint32_t>(trajectory.rows);
}

/// All demonstrations of the key, one file or a list of them; false after an error.
bool read_demonstrations(SectionReader& section, const RobotFile& robot, std::vector<Trajectory>& runs) {
  const toml::node& node = *section.node("demonstration");
  const std::size_t before = section.errors().list().size();
  if (const toml::array* list = node.as_array()) {
    for (const toml::node& element : *list) {
      runs.emplace_back();
      (void)read_rows(section.errors(), element, "cost.demonstration", robot, runs.back());
    }
  } else {
    runs.emplace_back();
    (void)read_rows(section.errors(), node, "cost.demonstration", robot, runs.back());
  }
  if (section.errors().list().size() != before) return false;
  if (runs.size() == 1 ? runs[0].sd.empty() : runs.size() < 2) {
    section.error("demonstration", "one demonstration has no spread",
                  "list several, or name a CSV of time_s and mean.<state> and sd.<state> of every state");
    return false;
  }
  return true;
}

void read_demonstration(SectionReader& section, RobotFile& robot, TaskRows& rows) {
  tiller_cost_config_t& cost = robot.config.cost;
  std::vector<Trajectory> runs;
  const bool diverges = cost.demonstration_divergence == tiller_divergence_kl;
  if (diverges && (!section.has("demonstration") || !(cost.demonstration_weight > 0)))
    section.error("demonstration_divergence", "there is no demonstration that the prediction could diverge from",
                  "write demonstration = [ files ] and a demonstration_weight above 0, or leave this out");
  if (!section.has("demonstration")) {
    if (cost.demonstration_weight > 0)
      section.error("demonstration_weight", "there is no demonstration to weigh", "write demonstration = [ files ]");
    return;
  }
  if (!read_demonstrations(section, robot, runs)) return;
  if (!section.has("demonstration_weight")) {
    section.missing("demonstration_weight", "write what deviating from the demonstration costs, e.g. 1");
    return;
  }
  Demonstration demonstration = runs.size() == 1 ? demonstration_of(runs[0], *robot.config.model)
                                                 : estimate_demonstration(runs, *robot.config.model);
  rows.demonstration_mean = std::move(demonstration.mean);
  rows.demonstration_root = std::move(demonstration.root);
  cost.demonstration_mean = rows.demonstration_mean.data();
  cost.demonstration_root = rows.demonstration_root.data();
  cost.demonstration_steps = static_cast<std::uint32_t>(demonstration.rows);
}

void read_own(SectionReader& section, RobotFile& robot) {
  const bool compiled = std::filesystem::path(robot.model_request.file).extension() == ".so";
  const bool own = robot.config.cost.own || !robot.model_request.cost_type.empty();
  if (robot.config.cost.own_weight > 0 && !own && !compiled) {
    section.error(
        "own_weight", "the model brings no cost of its own",
        "write model.cost_type = the cost's template in the model's header, or export tiller_cost() from a C source");
  }
  if (own && !section.has("own_weight")) robot.config.cost.own_weight = 1;
}

}  // namespace

void read_cost_terms(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  SectionReader section(errors, "cost", "cost", root["cost"].as_table());
  auto rows = std::make_shared<TaskRows>();
  read_bounds(section, robot);
  for (std::uint32_t kind = 0; kind < tiller_cost_term_kind_count; ++kind) read_catalogue_terms(section, kind, robot);
  read_reference(section, robot, *rows);
  read_demonstration(section, robot, *rows);
  read_outputs(section, robot, *rows);
  read_own(section, robot);
  robot.memory.rows = std::move(rows);
}

}  // namespace tiller::tools
