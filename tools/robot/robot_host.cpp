// [transport], [sim] and [log]: what the host's programs need beside the controller's configuration.

#include <filesystem>

#include "tools/base/frame_names.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/transport_names.hpp"

namespace tiller::tools {
namespace {

int line_of(const toml::node& node) { return static_cast<int>(node.source().begin.line); }

const KeySpec kFinite = {"", "", KeyKind::number, "", "", -1e12, 1e12, false, -1, nullptr, ""};

/// { name = number } with names that only the plant knows: it checks them when it is made.
void read_map(SectionReader& section, const std::string& key, std::map<std::string, double>& out) {
  const toml::table* table = section.subtable(key);
  if (!table) return;
  for (auto&& [name, node] : *table) {
    const std::string word(name.str());
    if (const auto value = checked_number(section.errors(), node, section.path_of(key + "." + word), kFinite)) {
      out[word] = *value;
    }
  }
}

void read_sensors(SectionReader& section, const RobotFile& robot, SimSection& sim) {
  const toml::table* table = section.subtable("sensors");
  if (!table || !knows_measurements(section.errors())) return;
  for (auto&& [name, node] : *table) {
    const std::string word(name.str());
    const std::string path = section.path_of("sensors." + word);
    if (index_of(robot.names.measurements, word) < 0) {
      section.errors().at(node, path, "is not measured", remedy_for_unknown(word, robot.names.measurements));
    } else if (!node.is_table()) {
      section.errors().at(node, path, "is " + kind_text(node), "write { sd = ..., step = ... }");
    } else {
      SectionReader sensor(section.errors(), "sim.sensors.*", path, node.as_table());
      sensor.refuse_unknown();
      sim.sensor_sd[word] = sensor.number("sd").value_or(0);
      sim.sensor_step[word] = sensor.number("step").value_or(0);
    }
  }
}

void read_sim_effect(FileErrors& errors, const toml::table& table, std::size_t index, SimSection& sim) {
  const std::string path = "sim.effects[" + std::to_string(index) + "]";
  SectionReader section(errors, "sim.effects[]", path, &table);
  SimEffect effect;
  if (!section.has("kind")) section.missing("kind", "name the hidden effect; `tiller sim --help` lists them");
  effect.kind = section.text("kind").value_or("");
  effect.port = section.text("port").value_or("");
  for (auto&& [name, node] : table) {
    const std::string word(name.str());
    if (word == "kind" || word == "port") continue;
    if (const char* now = renamed_key("sim.effects[]", word))
      errors.at(node, path + "." + word, std::string("is called ") + now + " now", std::string("write ") + now);
    if (const auto value = checked_number(errors, node, path + "." + word, kFinite)) {
      effect.parameters[word] = *value;
    }
  }
  sim.effects.push_back(std::move(effect));
}

void read_sim_effects(SectionReader& section, SimSection& sim) {
  const toml::node* node = section.node("effects");
  if (!node) return;
  const toml::array* list = node->as_array();
  if (!list) {
    section.error("effects", "is " + kind_text(*node), "head each effect with [[sim.effects]]");
    return;
  }
  std::size_t index = 0;
  for (const toml::node& element : *list) {
    ++index;
    if (const toml::table* table = element.as_table()) {
      read_sim_effect(section.errors(), *table, index, sim);
    } else {
      section.errors().at(element, "sim.effects", "is " + kind_text(element), "head each with [[sim.effects]]");
    }
  }
}

/// Keys that belong to another kind of transport would be ignored in silence: refuse them.
void refuse_foreign_keys(SectionReader& section, const std::string& kind) {
  for (const std::string& key : keys_of("transport")) {
    const std::string help = find_key("transport", key)->help;
    const bool common = help.find(':') == std::string::npos;
    if (!section.has(key) || common || help.compare(0, kind.size() + 1, kind + ":") == 0) continue;
    section.error(key, "is no key of the transport " + kind, "leave it out, or choose another kind");
  }
}

void read_motors(SectionReader& section, const RobotFile& robot, TransportSection& transport) {
  std::vector<double> nodes(robot.names.inputs.size(), -1);
  transport.wheel_radius_m.assign(robot.names.inputs.size(), 1);
  section.numbers("nodes", robot.names.inputs, "input", nodes.data());
  section.numbers("wheel_radius_m", robot.names.inputs, "input", transport.wheel_radius_m.data());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (section.has("nodes") && nodes[i] < 0) {
      section.error("nodes", "no CAN node for " + robot.names.inputs[i],
                    "add " + robot.names.inputs[i] + " = its node");
    }
    if (nodes[i] < 0) nodes[i] = static_cast<double>(i + 1);
    transport.nodes.push_back(static_cast<std::uint32_t>(nodes[i]));
    if (transport.wheel_radius_m[i] == 0) {
      section.error("wheel_radius_m", "a lever of zero moves nothing", "write the wheel's radius, or 1");
    }
  }
}

bool is_channel(const std::string& word, const Words& inputs) {
  const std::size_t colon = word.find(':');
  if (colon == std::string::npos) return false;
  const std::string source = word.substr(0, colon);
  const std::string rest = word.substr(colon + 1);
  if (source == "position" || source == "velocity") return index_of(inputs, rest) >= 0;
  const bool digits = !rest.empty() && rest.find_first_not_of("0123456789") == std::string::npos;
  return source == "board" && digits && rest.size() <= 2 && std::stoi(rest) <= 11;
}

void read_channels(SectionReader& section, const RobotFile& robot, TransportSection& transport) {
  const toml::table* table = section.subtable("channels");
  if (!table || !knows_measurements(section.errors())) return;
  transport.channels.assign(robot.names.measurements.size(), "");
  for (auto&& [name, node] : *table) {
    const std::string word(name.str());
    const std::string path = section.path_of("channels." + word);
    const int row = index_of(robot.names.measurements, word);
    const std::string text = node.value_or(std::string());
    if (row < 0) {
      section.errors().at(node, path, "is not measured", remedy_for_unknown(word, robot.names.measurements));
    } else if (!is_channel(text, robot.names.inputs)) {
      section.errors().at(node, path, "is no channel",
                          "write \"board:0\" to \"board:11\", or \"position:\" or \"velocity:\" and one of: " +
                              join(robot.names.inputs));
    } else {
      transport.channels[static_cast<std::size_t>(row)] = text;
    }
  }
  for (std::size_t i = 0; i < robot.names.measurements.size(); ++i) {
    if (!table->contains(robot.names.measurements[i])) {
      section.error("channels", "no channel for " + robot.names.measurements[i],
                    "add " + robot.names.measurements[i] + " = \"board:" + std::to_string(i) + "\"");
    }
  }
}

}  // namespace

bool knows_measurements(const FileErrors& errors) {
  return !errors.has_below("measurement") && !errors.has_below("[measurement]");
}

void read_transport(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "transport");
  if (!table) return;
  SectionReader section(errors, "transport", "transport", table);
  TransportSection& transport = robot.transport;
  transport.line = line_of(*table);
  section.refuse_unknown();
  if (!section.has("kind")) section.missing("kind", "write one of " + join(transport_names()));
  const auto kind = section.choice("kind");
  if (!kind) return;
  transport.kind = find_key("transport", "kind")->choices()[*kind];
  refuse_foreign_keys(section, transport.kind);
  if (const auto v = section.text("url")) transport.url = *v;
  if (const auto v = section.text("channel_prefix")) transport.channel_prefix = *v;
  if (const auto v = section.text("key_file"))
    transport.key_file = (std::filesystem::path(robot.path).parent_path() / *v).string();
  if (const auto v = section.number("replay_window_s")) transport.replay_window_s = *v;
  if (const auto v = section.flag("liblcm")) transport.liblcm = *v;
  if (const auto v = section.flag("stamp_on_arrival")) transport.stamp_on_arrival = *v;
  if (const auto v = section.text("interface")) transport.interface = *v;
  if (const auto v = section.count("sensor_node")) transport.sensor_node = static_cast<std::uint32_t>(*v);
  if (const auto v = section.number("heartbeat_timeout_s")) transport.heartbeat_timeout_s = *v;
  read_motors(section, robot, transport);
  read_drives(section, robot, transport);
  read_channels(section, robot, transport);
  read_ros2(section, robot, transport.ros2);
}

void read_plan_timeout(SectionReader& section, const RobotFile& robot, SimSection& sim) {
  const auto timeout_s = section.number("plan_timeout_s");
  if (!timeout_s) return;
  sim.plan_timeout_s = *timeout_s;
  if (*timeout_s == 0 || *timeout_s > robot.config.period_s) return;
  section.error("plan_timeout_s", "is no longer than the period, so that the motor would never run",
                "allow several periods of " + number_text(robot.config.period_s) + " s; 0 switches it off");
}

/// The plant of a description, and its keys, which no other plant reads.
void read_described(SectionReader& section, const RobotFile& robot, SimSection& sim) {
  const bool described = sim.plant == "urdf";
  for (const char* key : {"file", "frame", "hold", "armature"})
    if (!described && section.has(key))
      section.error(key, "is no key of the plant " + sim.plant, "leave it out, or write plant = \"urdf\"");
  if (!described) return;
  if (!section.has("file")) section.missing("file", "name the URDF, relative to the robot file");
  const std::filesystem::path file = section.text("file").value_or("");
  sim.file = (file.is_absolute() ? file : robot.model_request.robot_dir / file).string();
  sim.frame = section.text("frame").value_or("");
  read_map(section, "hold", sim.hold);
  read_map(section, "armature", sim.armature);
}

void read_sim(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "sim");
  SectionReader section(errors, "sim", "sim", table);
  SimSection& sim = robot.sim;
  sim.plant = section.text("plant").value_or(robot.config.model->name);
  if (!table) return;
  sim.line = line_of(*table);
  section.refuse_unknown();
  read_described(section, robot, sim);
  sim.draw = section.flag("draw").value_or(false);
  read_map(section, "parameters", sim.parameters);
  read_map(section, "state", sim.state);
  read_sensors(section, robot, sim);
  read_sim_effects(section, sim);
  if (const auto v = section.number("process_noise_sd")) sim.process_noise_sd = *v;
  if (const auto v = section.number("measurement_latency_s")) sim.measurement_latency_s = *v;
  if (const auto v = section.number("command_latency_s")) sim.command_latency_s = *v;
  if (const auto v = section.number("watchdog_s")) sim.watchdog_s = *v;
  read_plan_timeout(section, robot, sim);
  if (const auto v = section.number("step_s")) sim.step_s = *v;
  sim.rates = section.flag("rates").value_or(false);
  if (const auto v = section.count("seed")) sim.seed = static_cast<std::uint64_t>(*v);
}

// schedule = { torque_Nm = { column = "volts", nominal = 12 } }
void read_schedule(SectionReader& section, FileErrors& errors, const Words& inputs, LogMap& log) {
  const toml::table* schedules = section.subtable("schedule");
  if (!schedules) return;
  for (auto&& [name, node] : *schedules) {
    const std::string word(name.str()), path = section.path_of("schedule." + word);
    const toml::table* entry = node.as_table();
    const auto column = entry ? (*entry)["column"].value<std::string>() : std::nullopt;
    const double nominal = entry ? (*entry)["nominal"].value_or<double>(NAN) : NAN;
    if (index_of(inputs, word) < 0)
      errors.at(node, path, "is no input of the model", remedy_for_unknown(word, inputs));
    else if (!column || std::isnan(nominal) || entry->size() != 2)
      errors.at(node, path, "is not a column with its nominal value",
                "write " + word +
                    " = { column = \"volts\", nominal = 12 }: what the column reads where the input acts as commanded");
    else if (!(nominal > 0) || !std::isfinite(nominal))
      errors.at(node, path, "has the nominal value " + format("%.6g", nominal), "write a number above 0");
    else
      log.schedule[word] = {*column, nominal};
  }
}

// [[log.sensors]] column = "camera_x_mm", of = "tip_x_m", sd = 0.002, factor = 0.001
void read_log_sensors(SectionReader& section, const RobotFile& robot, LogMap& log) {
  const toml::node* node = section.node("sensors");
  if (!node) return;
  const toml::array* list = node->as_array();
  if (!list) return section.error("sensors", "is " + kind_text(*node), "head each sensor with [[log.sensors]]");
  Words known = robot.names.states;
  const tiller_model_t& model = *robot.config.model;
  for (std::uint32_t i = 0; model.outputs && i < model.output_count; ++i) known.emplace_back(model.output_names[i]);
  std::size_t index = 0;
  for (const toml::node& element : *list) {
    const std::string path = "log.sensors[" + std::to_string(++index) + "]";
    SectionReader one(section.errors(), "log.sensors[]", path, element.as_table());
    if (!element.is_table()) {
      section.errors().at(element, path, "is " + kind_text(element), "head each sensor with [[log.sensors]]");
      continue;
    }
    one.refuse_unknown();
    LogSensor sensor;
    const auto column = one.text("column"), of = one.text("of");
    const auto sd = one.number("sd"), factor = one.number("factor"), zero = one.number("zero");
    const auto derivative = one.count("derivative");
    const bool accelerometer = one.flag("accelerometer").value_or(false);
    if (!one.has("column")) one.missing("column", "write column = \"...\", the sensor's name in the logs");
    if (!one.has("of")) one.missing("of", "write of = \"...\", one of " + join(known));
    if (!one.has("sd")) one.missing("sd", "write sd = ..., the standard deviation of its noise in SI units");
    if (of && index_of(known, *of) < 0)
      one.error("of", "'" + *of + "' is no state or output of the model", remedy_for_unknown(*of, known));
    if (factor && *factor == 0) one.error("factor", "is 0", "write the SI units in one of the column's");
    if (of && accelerometer && frame_under(known, *of).empty())
      one.error("of", "'" + *of + "' is no position of a frame, and an accelerometer rides on one",
                "write an output such as imu_x_m, of a frame whose rotation the model tells too");
    if (accelerometer && one.has("derivative"))
      one.error("derivative", "stands beside accelerometer = true", "leave derivative out");
    if (of && (accelerometer || derivative.value_or(0) == 2) && !joints_tell_rate(model, *of))
      one.error("derivative", "is 2, and the model does not tell the second derivative of " + *of,
                "leave the sensor out; of a joint's position it does, and of an output where each state is a joint's");
    if (!column || !of || !sd) continue;
    sensor.column = *column;
    sensor.of = *of;
    sensor.sd = *sd;
    sensor.derivative = accelerometer ? 2 : static_cast<int>(derivative.value_or(0));
    sensor.accelerometer = accelerometer;
    sensor.factor = factor.value_or(1);
    sensor.zero = zero.value_or(0);
    log.sensors.push_back(sensor);
  }
}

void read_log_map(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "log");
  SectionReader section(errors, "log", "log", table);
  if (!table) return;
  section.refuse_unknown();
  LogMap& log = robot.log;
  if (const auto time = section.text("time")) log.time = *time;
  if (const auto row_s = section.number("row_s")) log.row_s = *row_s;
  log.undriven = section.flag("undriven").value_or(false);
  if (const auto input = section.choice("input")) log.input = find_key("log", "input")->choices()[*input];
  Words names = robot.names.states;
  names.insert(names.end(), robot.names.inputs.begin(), robot.names.inputs.end());
  const auto read_words = [&](const char* key, const Words& known, std::map<std::string, std::string>& out) {
    const toml::table* words = section.subtable(key);
    if (!words) return;
    for (auto&& [name, node] : *words) {
      const std::string word(name.str());
      const std::string path = section.path_of(std::string(key) + "." + word);
      if (index_of(known, word) < 0) {
        errors.at(node, path, "is no state or input of the model", remedy_for_unknown(word, known));
      } else if (!node.is_string()) {
        errors.at(node, path, "is " + kind_text(node), "write a text in quotes");
      } else {
        out[word] = *node.value<std::string>();
      }
    }
  };
  read_words("columns", names, log.columns);
  if (const toml::table* zeros = section.subtable("zeros"))
    for (auto&& [name, node] : *zeros) {
      const std::string word(name.str()), path = section.path_of("zeros." + word);
      if (index_of(names, word) < 0)
        errors.at(node, path, "is no state or input of the model", remedy_for_unknown(word, names));
      else if (!node.is_number() || !std::isfinite(*node.value<double>()))
        errors.at(node, path, "is no number",
                  "write what the column reads where " + word + " is 0, in the column's unit");
      else
        log.zeros[word] = *node.value<double>();
    }
  read_schedule(section, errors, robot.names.inputs, log);
  read_log_sensors(section, robot, log);
  names.emplace_back("time");
  read_words("units", names, log.units);
  for (const auto& [name, unit] : log.units) {
    if (unit_factor(unit) == 0) {
      errors.at(*table->get("units"), section.path_of("units." + name), "unit '" + unit + "' is not known",
                "known: " + known_units());
    }
  }
}

}  // namespace tiller::tools
