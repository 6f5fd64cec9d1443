// [measurement], [limits] and the HOLD gain of [safety].

#include <algorithm>

#include "tiller/config.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

void read_measurement(FileErrors& errors, const Entry& entry, RobotFile& robot) {
  Config& config = robot.config;
  const std::uint32_t row = config.measurement_count;
  const std::string path = "measurement." + entry.name;
  SectionReader sensor(errors, "measurement.*", path, entry.node->as_table());
  sensor.refuse_unknown();
  if (!sensor.has("sd")) sensor.missing("sd", "write sd = the sensor's standard deviation, above 0");
  if (const auto sd = sensor.number("sd")) config.measurement_sd[row] = *sd;
  const auto low = sensor.number("low");
  const auto high = sensor.number("high");
  (void)sensor.in_order("low", low, "high", high);
  if (low) config.measurement_low[row] = *low;
  if (high) config.measurement_high[row] = *high;
  if (const auto rate = sensor.number("rate_per_s")) config.measurement_rate_per_s[row] = *rate;
}

void read_limit(FileErrors& errors, const Entry& entry, std::size_t input, RobotFile& robot) {
  tiller_safety_config_t& safety = robot.config.safety;
  SectionReader limit(errors, "limits.*", "limits." + entry.name, entry.node->as_table());
  limit.refuse_unknown();
  for (const char* key : {"low", "high"}) {
    if (!limit.has(key)) limit.missing(key, std::string("write ") + key + " = a command that cannot do harm");
  }
  const auto low = limit.number("low");
  const auto high = limit.number("high");
  if (!limit.in_order("low", low, "high", high)) return;
  if (low) safety.input_low[input] = *low;
  if (high) safety.input_high[input] = *high;
  if (const auto rate = limit.number("rate_per_s")) safety.input_rate_per_s[input] = *rate;
  if (const auto safe = limit.number("safe")) safety.safe_command[input] = *safe;
  if (low && high) {
    const double safe = safety.safe_command[input];
    if (safe < *low || safe > *high) {
      limit.error("safe", "the safe command " + number_text(safe) + " is outside the limits",
                  "write safe = a command between low = " + number_text(*low) + " and high = " + number_text(*high));
    }
  }
}

}  // namespace

std::vector<Entry> in_file_order(const toml::table& table) {
  std::vector<Entry> entries;
  for (auto&& [name, node] : table) entries.push_back({std::string(name.str()), &node});
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    const toml::source_position& x = a.node->source().begin;
    const toml::source_position& y = b.node->source().begin;
    return x.line != y.line ? x.line < y.line : x.column < y.column;
  });
  return entries;
}

const toml::table* section_table(FileErrors& errors, const toml::table& root, const std::string& name) {
  const toml::node* node = root.get(name);
  if (!node) return nullptr;
  if (!node->is_table()) errors.at(*node, name, "is " + kind_text(*node), "head the section with [" + name + "]");
  return node->as_table();
}

void read_measurements(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "measurement");
  robot.config.measurement_count = 0;
  if (!table || table->empty()) {
    errors.missing(table, "[measurement]",
                   "name at least one measured state, e.g. " + robot.names.states.front() +
                       " = { sd = 0.001 }; states: " + join(robot.names.states));
    return;
  }
  for (const Entry& entry : in_file_order(*table)) {
    const std::string path = "measurement." + entry.name;
    const int state = index_of(robot.names.states, entry.name);
    if (state < 0) {
      errors.at(*entry.node, path, std::string(robot.config.model->name) + " has no state of that name",
                remedy_for_unknown(entry.name, robot.names.states));
      continue;
    }
    if (!entry.node->is_table()) {
      errors.at(*entry.node, path, "is " + kind_text(*entry.node), "write { sd = ... }");
      continue;
    }
    read_measurement(errors, entry, robot);
    robot.names.measurements.push_back(entry.name);
    robot.config.measured_state[robot.config.measurement_count++] = static_cast<std::uint8_t>(state);
  }
}

void read_limits(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "limits");
  if (table) {
    for (const Entry& entry : in_file_order(*table)) {
      const int input = index_of(robot.names.inputs, entry.name);
      if (input < 0) {
        errors.at(*entry.node, "limits." + entry.name,
                  std::string(robot.config.model->name) + " has no input of that name",
                  remedy_for_unknown(entry.name, robot.names.inputs));
      } else if (!entry.node->is_table()) {
        errors.at(*entry.node, "limits." + entry.name, "is " + kind_text(*entry.node),
                  "write { low = ..., high = ... }");
      } else {
        read_limit(errors, entry, static_cast<std::size_t>(input), robot);
      }
    }
  }
  for (const std::string& input : robot.names.inputs) {
    if (table && table->contains(input)) continue;
    errors.missing(table, "limits." + input,
                   "every input needs limits: " + input + " = { low = ..., high = ... } below [limits]");
  }
}

void read_hold_gain(SectionReader& safety, RobotFile& robot) {
  const toml::table* table = safety.subtable("hold_gain");
  if (!table) return;
  const KeySpec& base = *find_key("safety", "hold_gain");
  KeySpec spec = base;
  spec.low = -TILLER_LARGEST_VALUE;
  spec.high = TILLER_LARGEST_VALUE;
  for (auto&& [input_name, row] : *table) {
    const std::string input(input_name.str());
    const std::string path = safety.path_of("hold_gain." + input);
    const int u = index_of(robot.names.inputs, input);
    if (u < 0) {
      safety.errors().at(row, path, "the model has no input of that name",
                         remedy_for_unknown(input, robot.names.inputs));
      continue;
    }
    if (!row.is_table()) {
      safety.errors().at(row, path, "is " + kind_text(row), "write { state = gain, ... }");
      continue;
    }
    for (auto&& [state_name, gain] : *row.as_table()) {
      const std::string state(state_name.str());
      const int x = index_of(robot.names.states, state);
      if (x < 0) {
        safety.errors().at(gain, path + "." + state, "the model has no state of that name",
                           remedy_for_unknown(state, robot.names.states));
      } else if (const auto value = checked_number(safety.errors(), gain, path + "." + state, spec)) {
        robot.config.hold_gain[static_cast<std::size_t>(u) * robot.names.states.size() + static_cast<std::size_t>(x)] =
            *value;
      }
    }
  }
}

}  // namespace tiller::tools
