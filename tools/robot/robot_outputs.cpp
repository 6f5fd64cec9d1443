// [cost] outputs, frames and clearance: what the model's outputs cost.

#include <array>
#include <cmath>
#include <set>

#include "tools/base/frame_names.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

/// The robot's outputs with nothing asked of them.
std::vector<tiller_output_cost_t> no_costs(std::size_t count) {
  return std::vector<tiller_output_cost_t>(count, {0.0, 0.0, 0.0, -INFINITY, INFINITY, 0.0});
}

void read_output(FileErrors& errors, const std::string& name, const toml::table& table, tiller_output_cost_t& out) {
  SectionReader section(errors, "cost.outputs.*", "cost.outputs." + name, &table);
  const std::size_t before = errors.list().size();
  section.refuse_unknown();
  const auto target = section.number("target");
  const auto weight = section.number("weight"), terminal = section.number("terminal_weight");
  const auto low = section.number("low"), high = section.number("high");
  const auto bound = section.number("bound_weight");
  if (errors.list().size() != before) return;
  const bool is_target = weight.value_or(0) > 0 || terminal.value_or(0) > 0;
  if (is_target && !target) section.missing("target", "write where the output is wanted");
  if (target && !is_target) section.missing("weight", "write what being off the target costs");
  if ((low || high) && bound.value_or(0) <= 0)
    section.missing("bound_weight", "write what being outside of the bounds costs");
  if (bound.value_or(0) > 0 && !low && !high) section.missing("low", "write low, high, or both");
  (void)section.in_order("low", low, "high", high);
  out = {target.value_or(0),      weight.value_or(0),      terminal.value_or(weight.value_or(0)),
         low.value_or(-INFINITY), high.value_or(INFINITY), bound.value_or(0)};
}

void read_frame(FileErrors& errors, const std::string& name, const toml::table& table, const RobotFile& robot,
                std::vector<tiller_output_cost_t>& costs, std::set<std::string>& taken) {
  SectionReader section(errors, "cost.frames.*", "cost.frames." + name, &table);
  const std::size_t before = errors.list().size();
  section.refuse_unknown();
  std::array<double, 3> position{}, rpy{};
  const bool has_position = section.has("position_m"), has_rotation = section.has("rpy_rad");
  if (has_position) (void)read_triple(section, "position_m", position);
  if (has_rotation) (void)read_triple(section, "rpy_rad", rpy);
  if (!has_position && !has_rotation) section.missing("position_m", "write position_m, rpy_rad, or both");
  const auto weight = section.number("weight"), terminal = section.number("terminal_weight");
  const auto turn = section.number("rotation_weight"), last_turn = section.number("terminal_rotation_weight");
  if (has_position && !(weight.value_or(0) > 0) && !(terminal.value_or(0) > 0))
    section.missing("weight", "write what a metre off the position costs, in 1/m^2");
  if (has_rotation && !(turn.value_or(0) > 0) && !(last_turn.value_or(0) > 0))
    section.missing("rotation_weight", "write what a radian off the rotation costs, in 1/rad^2");
  if (errors.list().size() != before) return;
  const auto names = frame_output_names(name);
  const std::array<double, 9> rotation = rotation_of(rpy);
  const auto set = [&](std::size_t i, double target, double w, double last) {
    const auto at = static_cast<std::size_t>(index_of(robot.names.outputs, names[i]));
    costs[at].target = target;
    costs[at].weight = w;
    costs[at].terminal_weight = last;
    taken.insert(names[i]);
  };
  for (std::size_t i = 0; has_position && i < 3; ++i)
    set(i, position[i], weight.value_or(0), terminal.value_or(weight.value_or(0)));
  // |R - R*|^2 is 8 sin^2(angle / 2), for small angles twice their square
  for (std::size_t i = 0; has_rotation && i < 9; ++i)
    set(3 + i, rotation[i], 0.5 * turn.value_or(0), 0.5 * last_turn.value_or(turn.value_or(0)));
}

/// The frames that the outputs' names tell of.
Words frames_of(const RobotFile& robot) {
  Words frames;
  for (const std::string& output : robot.names.outputs) {
    const std::size_t end = output.size() > 4 ? output.size() - 4 : 0;
    if (end == 0 || output.compare(end, 4, "_x_m") != 0) continue;
    const std::string frame = output.substr(0, end);
    bool whole = true;
    for (const std::string& name : frame_output_names(frame)) whole = whole && index_of(robot.names.outputs, name) >= 0;
    if (whole) frames.push_back(frame);
  }
  return frames;
}

/// Calls read(name, table) for each key of a table of tables whose names are `known`.
template <class Read>
void each_named(SectionReader& section, const char* key, const Words& known, const char* what, const Read& read) {
  const toml::table* table = section.subtable(key);
  if (!table) return;
  for (const Entry& entry : in_file_order(*table)) {
    const std::string path = section.path_of(std::string(key) + "." + entry.name);
    if (index_of(known, entry.name) < 0)
      section.errors().at(*entry.node, path, std::string("the model has no ") + what + " of that name",
                          known.empty() ? std::string("the model tells none: see tiller/model.hpp, outputs")
                                        : remedy_for_unknown(entry.name, known));
    else if (!entry.node->is_table())
      section.errors().at(*entry.node, path, "is " + kind_text(*entry.node), "write a table { ... }");
    else
      read(entry.name, *entry.node->as_table());
  }
}

}  // namespace

bool read_triple(SectionReader& section, const std::string& key, std::array<double, 3>& out) {
  const toml::node* node = section.node(key);
  const toml::array* list = node ? node->as_array() : nullptr;
  bool good = list && list->size() == 3;
  for (std::size_t i = 0; good && i < 3; ++i) {
    const auto value = (*list)[i].value<double>();
    good = value && std::fabs(*value) <= TILLER_LARGEST_VALUE;
    if (good) out[i] = *value;
  }
  if (!good)
    section.error(key, "is " + (list ? std::string("no list of three numbers") : kind_text(*node)),
                  "write three numbers, e.g. [0.4, 0.0, 0.3]");
  return good;
}

void read_outputs(SectionReader& section, RobotFile& robot, TaskRows& rows) {
  if (!section.has("outputs") && !section.has("frames") && !section.has("clearance")) return;
  std::vector<tiller_output_cost_t> costs = no_costs(robot.names.outputs.size());
  std::set<std::string> taken;
  each_named(section, "frames", frames_of(robot), "frame", [&](const std::string& name, const toml::table& table) {
    read_frame(section.errors(), name, table, robot, costs, taken);
  });
  rows.clearance = read_clearance(section, robot, costs);
  for (const ClearanceOutput& bounded : rows.clearance) taken.insert(bounded.output);
  each_named(section, "outputs", robot.names.outputs, "output", [&](const std::string& name, const toml::table& table) {
    if (taken.count(name) > 0)
      return section.errors().at(*section.node("outputs"), "cost.outputs." + name,
                                 "is part of a frame or of the clearance, which are told already",
                                 "leave one of the two out");
    read_output(section.errors(), name, table, costs[static_cast<std::size_t>(index_of(robot.names.outputs, name))]);
  });
  rows.outputs = std::move(costs);
  if (rows.outputs.empty()) return;
  robot.config.cost.outputs = rows.outputs.data();
  robot.config.cost.output_count = static_cast<std::uint32_t>(rows.outputs.size());
}

}  // namespace tiller::tools
