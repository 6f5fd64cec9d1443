// [transport] actuator and drives: what the motors on a CAN bus speak.

#include <cmath>

#include "tools/robot/drive_settings.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

void take_actuator(SectionReader& section, const toml::node& node, const std::string& path, DriveSection& drive) {
  const std::string word = node.value_or(std::string());
  if (index_of(actuator_words(), word) >= 0)
    drive.actuator = word;
  else
    section.errors().at(node, path, "is no actuator", "write one of: " + join(actuator_words()));
}

/// One word for all, or a table with one for each.
void read_actuators(SectionReader& section, const RobotFile& robot, TransportSection& transport) {
  const toml::node* node = section.node("actuator");
  if (node == nullptr) return;
  const toml::table* table = node->as_table();
  for (std::size_t i = 0; table == nullptr && i < transport.drives.size(); ++i) {
    take_actuator(section, *node, section.path_of("actuator"), transport.drives[i]);
    if (transport.drives[i].actuator != node->value_or(std::string())) return;  // said once
  }
  if (table == nullptr) return;
  for (auto&& [name, value] : *table) {
    const std::string word(name.str());
    const std::string path = section.path_of("actuator." + word);
    const int input = index_of(robot.names.inputs, word);
    if (input < 0)
      section.errors().at(value, path, "is no input", remedy_for_unknown(word, robot.names.inputs));
    else
      take_actuator(section, value, path, transport.drives[static_cast<std::size_t>(input)]);
  }
}

/// A key of another protocol would be ignored in silence.
void refuse_other_protocols(SectionReader& drive, const std::string& actuator) {
  for (const std::string& key : keys_of("transport.drives.*")) {
    const std::string help = find_key("transport.drives.*", key)->help;
    const std::size_t colon = help.find(':');
    const std::string owner = help.substr(0, colon == std::string::npos ? 0 : colon);
    if (!drive.has(key) || index_of(actuator_words(), owner) < 0 || owner == actuator) continue;
    drive.error(key, "is no key of an " + actuator + " drive", "leave it out; it belongs to " + owner);
  }
}

std::string choice_word(SectionReader& section, const std::string& key, const std::string& fallback) {
  const auto choice = section.choice(key);
  return choice ? find_key("transport.drives.*", key)->choices()[*choice] : fallback;
}

void read_drive(SectionReader& section, DriveSection& drive) {
  section.refuse_unknown();
  refuse_other_protocols(section, drive.actuator);
  drive.command = choice_word(section, "command", drive.command);
  drive.resolution = choice_word(section, "resolution", drive.resolution);
  drive.reply = choice_word(section, "reply", drive.reply);
  const std::pair<const char*, double*> numbers[] = {{"watchdog_s", &drive.watchdog_s},
                                                     {"position_rad", &drive.position_rad},
                                                     {"velocity_rad_s", &drive.velocity_rad_s},
                                                     {"torque_Nm", &drive.torque_Nm},
                                                     {"kp_max", &drive.kp_max},
                                                     {"kd_max", &drive.kd_max},
                                                     {"kp_Nm_rad", &drive.kp_Nm_rad},
                                                     {"kd_Nms_rad", &drive.kd_Nms_rad}};
  for (const auto& [key, out] : numbers)
    if (const auto value = section.number(key)) *out = *value;
  if (const auto value = section.count("reply_id")) drive.reply_id = static_cast<std::uint32_t>(*value);
}

/// The protocol clips what does not fit its numbers: limits beyond would be promised to the planner and not kept.
void check_range(SectionReader& section, const RobotFile& robot, std::size_t i, const TransportSection& transport,
                 const ActuatorSettings& settings) {
  const DriveSection& drive = transport.drives[i];
  if ((actuator_protocol(settings.kind).capabilities & kEndsAtRange) == 0) return;
  const double lever = std::fabs(transport.wheel_radius_m[i]);
  const double limit =
      std::fmax(std::fabs(robot.config.safety.input_low[i]), std::fabs(robot.config.safety.input_high[i]));
  const double wanted = drive.command == "torque" ? limit * lever : limit / lever;
  const double most = drive.command == "torque"     ? drive.torque_Nm
                      : drive.command == "velocity" ? drive.velocity_rad_s
                                                    : drive.position_rad;
  if (!(lever > 0) || !(wanted > most)) return;
  section.error("drives",
                "[limits] " + robot.names.inputs[i] + " asks for " + number_text(wanted) +
                    " of a drive whose range ends at " + number_text(most),
                "narrow [limits], or correct the drive's " + drive.command + " range");
}

/// What the protocol itself takes: its nodes, and combinations of settings.
void check_drive(SectionReader& section, const RobotFile& robot, std::size_t i, const TransportSection& transport) {
  ActuatorSettings settings;
  std::string error;
  if (!drive_settings(transport.drives[i], transport.nodes[i], settings, error))
    return section.error("drives", error, "correct drives." + robot.names.inputs[i]);
  const ActuatorName& name = actuator_name(settings.kind);
  if (settings.node < name.first_node || settings.node > name.last_node)
    return section.error("nodes",
                         std::string(name.motor) + " has a node from " + std::to_string(name.first_node) + " to " +
                             std::to_string(name.last_node),
                         "choose another for " + robot.names.inputs[i]);
  if (const char* defect = actuator_protocol(settings.kind).settings_error(settings))
    return section.error("drives", defect, "correct drives." + robot.names.inputs[i] + ", or its node");
  check_range(section, robot, i, transport, settings);
}

}  // namespace

void read_drives(SectionReader& section, const RobotFile& robot, TransportSection& transport) {
  transport.drives.assign(robot.names.inputs.size(), DriveSection());
  read_actuators(section, robot, transport);
  if (const toml::table* table = section.subtable("drives")) {
    for (auto&& [name, node] : *table) {
      const std::string word(name.str());
      const std::string path = section.path_of("drives." + word);
      const int input = index_of(robot.names.inputs, word);
      if (input < 0) {
        section.errors().at(node, path, "is no input", remedy_for_unknown(word, robot.names.inputs));
      } else if (!node.is_table()) {
        section.errors().at(node, path, "is " + kind_text(node), "write { command = \"torque\", ... }");
      } else {
        SectionReader drive(section.errors(), "transport.drives.*", path, node.as_table());
        read_drive(drive, transport.drives[static_cast<std::size_t>(input)]);
      }
    }
  }
  for (std::size_t i = 0; i < transport.drives.size(); ++i) {
    if (transport.drives[i].command == "position" && !(robot.config.safety.input_rate_per_s[i] < 1e300))
      section.error("drives", "commands a position without a rate limit",
                    "add rate_per_s to [limits] " + robot.names.inputs[i]);
    check_drive(section, robot, i, transport);
  }
}

}  // namespace tiller::tools
