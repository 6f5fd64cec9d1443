// [transport] of the kind ros2: topics, and where values come from.

#include <cctype>

#include "ros2/ros2_source.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/ros2_topics.hpp"

namespace tiller::tools {
namespace {

void read_sources(SectionReader& section, const RobotFile& robot, Words& sources) {
  const toml::table* table = section.subtable("sources");
  if (!table || !knows_measurements(section.errors())) return;
  sources.assign(robot.names.measurements.size(), "");
  for (auto&& [name, node] : *table) {
    const std::string word(name.str());
    const std::string path = section.path_of("sources." + word);
    const int row = index_of(robot.names.measurements, word);
    const std::string text = node.value_or(std::string());
    Ros2Source source;
    if (row < 0)
      section.errors().at(node, path, "is not measured", remedy_for_unknown(word, robot.names.measurements));
    else if (!ros2_parse_source(text.c_str(), &source))
      section.errors().at(node, path, "is no value of a message",
                          "write \"position:\", \"velocity:\" or \"effort:\" and a joint's name, or \"imu:\" or "
                          "\"odometry:\" and a field, \"imu:angular_velocity.z\"");
    else
      sources[static_cast<std::size_t>(row)] = text;
  }
  for (const std::string& name : robot.names.measurements)
    if (!table->contains(name))
      section.error("sources", "no source for " + name, "add " + name + " = \"position:joint\"");
}

void read_goal_fields(SectionReader& section, const RobotFile& robot, std::map<std::string, std::string>& fields) {
  const toml::table* table = section.subtable("goal_fields");
  if (!table) return;
  for (auto&& [name, node] : *table) {
    const std::string word(name.str());
    const std::string path = section.path_of("goal_fields." + word);
    const std::string text = node.value_or(std::string());
    const bool known = index_of(robot.names.states, word) >= 0 || index_of(robot.names.outputs, word) >= 0;
    if (!known)
      section.errors().at(node, path, "is neither a state nor an output that [cost] weighs",
                          remedy_for_unknown(word, robot.names.states));
    else if (ros2_pose_field(text.c_str()) < 0)
      section.errors().at(node, path, "is no field of a pose",
                          "write \"position.x\", \"orientation.w\", \"yaw\" or another of position.x, .y, .z, "
                          "orientation.x, .y, .z, .w, roll, pitch and yaw");
    else
      fields[word] = text;
  }
}

/// The robot's name in letters that ROS 2 allows.
std::string plain_name(const RobotFile& robot) {
  std::string name = robot.name;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
}

std::string below_the_name(const RobotFile& robot, const char* end) {
  std::string name = plain_name(robot);
  if (name.empty() || std::isdigit(static_cast<unsigned char>(name[0])) != 0) name.insert(0, "_");
  return name + "/" + end;
}

}  // namespace

std::string ros2_commands_topic(const RobotFile& robot) {
  const std::string& given = robot.transport.ros2.commands;
  return given.empty() ? below_the_name(robot, "commands") : given;
}

std::string ros2_trajectory_topic(const RobotFile& robot) {
  const std::string& given = robot.transport.ros2.goal_trajectory;
  return given.empty() ? below_the_name(robot, "joint_trajectory") : given;
}

std::string ros2_node_name(const RobotFile& robot) { return "tiller_" + plain_name(robot); }

void read_ros2(SectionReader& section, const RobotFile& robot, Ros2Section& ros2) {
  if (const auto v = section.text("joint_states")) ros2.joint_states = *v;
  if (const auto v = section.text("imu")) ros2.imu = *v;
  if (const auto v = section.text("odometry")) ros2.odometry = *v;
  if (const auto v = section.text("commands")) ros2.commands = *v;
  if (const auto v = section.text("goal_trajectory")) ros2.goal_trajectory = *v;
  if (const auto v = section.text("goal_pose")) ros2.goal_pose = *v;
  read_sources(section, robot, ros2.sources);
  read_goal_fields(section, robot, ros2.goal_fields);
}

}  // namespace tiller::tools
