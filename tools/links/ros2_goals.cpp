#include "tools/links/ros2_goals.hpp"

#include <cmath>

#include "tools/robot/ros2_topics.hpp"

namespace tiller::tools {
namespace {

bool is_usable(double value) { return std::fabs(value) <= TILLER_LARGEST_VALUE; }  // false for NaN

}  // namespace

/// A measured state comes from a joint as the robot file says; others are found by their names.
Ros2Goals::Ros2Goals(const RobotFile& robot) : robot_(robot), target_(robot) {
  const Ros2Section& section = robot.transport.ros2;
  for (std::size_t i = 0; i < robot.names.states.size(); ++i) {
    const std::string& name = robot.names.states[i];
    const int row = section.sources.empty() ? -1 : index_of(robot.names.measurements, name);
    Ros2Source source;
    const bool known = row >= 0 ? ros2_parse_source(section.sources[static_cast<std::size_t>(row)].c_str(), &source)
                                : ros2_source_of_name(name.c_str(), &source);
    if (known && source.message == Ros2Message::kJointState) sources_.push_back({source.joint, source.field, i});
  }
  for (const auto& [name, field] : section.goal_fields) {
    const int output = index_of(robot.names.outputs, name);
    const int target = output >= 0 ? output : index_of(robot.names.states, name);
    pose_.push_back(
        {static_cast<std::size_t>(ros2_pose_field(field.c_str())), static_cast<std::size_t>(target), output >= 0});
  }
}

bool Ros2Goals::open(std::string& error) {
  OpenError problem;
  const std::string pose = pose_.empty() ? "" : robot_.transport.ros2.goal_pose;
  const std::string trajectory = sources_.empty() ? "" : ros2_trajectory_topic(robot_);
  if (pose.empty() && trajectory.empty()) {
    error = robot_.path + ": --goals ros2: no state belongs to a joint, and [transport] goal_fields says of no pose " +
            "what it sets; add goal_fields = { state_or_output = \"position.x\" }";
    return false;
  }
  const std::string node = ros2_node_name(robot_) + "_goals";
  const tiller_status_t status = reader_.open(trajectory.c_str(), pose.c_str(), node.c_str(), &problem);
  if (status == tiller_status_ok) return true;
  error = robot_.path + ": [transport] " + (problem.text[0] ? problem.text : tiller_status_text(status));
  return false;
}

const Ros2Goals::StateSource* Ros2Goals::find(const char* joint, int field) const {
  for (const StateSource& source : sources_)
    if (source.field == field && source.joint == joint) return &source;
  return nullptr;
}

bool Ros2Goals::take_joint(const Ros2JointGoal& goal, std::uint32_t joint, std::vector<double>& states) {
  const StateSource* const position = find(goal.joint[joint], 0);
  const StateSource* const velocity = find(goal.joint[joint], 1);
  const bool has_position = joint < goal.positions, has_velocity = joint < goal.velocities;
  if (!position && !velocity) {
    target_.refuse(std::string("no state belongs to the joint ") + goal.joint[joint]);
    return false;
  }
  if ((has_position && !is_usable(goal.position[joint])) || (has_velocity && !is_usable(goal.velocity[joint]))) {
    target_.refuse(std::string("a value of the joint ") + goal.joint[joint] + " is not finite, or too large");
    return false;
  }
  if (position && has_position) states[position->state] = goal.position[joint];
  if (velocity && has_velocity) states[velocity->state] = goal.velocity[joint];
  return true;
}

void Ros2Goals::take(const Ros2JointGoal& goal) {
  if (goal.joints == 0 || (goal.positions != goal.joints && goal.velocities != goal.joints))
    return target_.refuse("a trajectory's last point has no value for each of its joints");
  std::vector<double> states = target_.states();
  for (std::uint32_t joint = 0; joint < goal.joints; ++joint)
    if (!take_joint(goal, joint, states)) return;
  target_.states() = states;
  target_.take(true, false);
}

void Ros2Goals::take_pose(const double (&pose)[kRos2PoseNumbers]) {
  for (const PoseTarget& target : pose_)
    if (!is_usable(pose[target.number])) return target_.refuse("a number of a pose is not finite, or too large");
  bool states = false, outputs = false;
  for (const PoseTarget& target : pose_) {
    (target.is_output ? target_.outputs() : target_.states())[target.target] = pose[target.number];
    (target.is_output ? outputs : states) = true;
  }
  target_.take(states, outputs);
}

bool Ros2Goals::poll(Goal& goal) {
  constexpr int kMost = 16;  // a flood cannot hold a tick
  Ros2JointGoal joints;
  for (int i = 0; i < kMost && reader_.take(&joints); ++i) take(joints);
  double pose[kRos2PoseNumbers];
  for (int i = 0; i < kMost && reader_.take(pose); ++i) take_pose(pose);
  return target_.poll(goal);
}

}  // namespace tiller::tools
