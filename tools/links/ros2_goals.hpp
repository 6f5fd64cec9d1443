#pragma once

#include <string>
#include <vector>

#include "ros2/ros2_goal_reader.hpp"
#include "tools/links/goal_source.hpp"

namespace tiller::tools {

/// Goals from topics of ROS 2, whatever the robot itself is reached by: the last point of a JointTrajectory sets the
/// states of its joints, a PoseStamped what [transport] goal_fields says.
class Ros2Goals final : public GoalSource {
 public:
  explicit Ros2Goals(const RobotFile& robot);

  bool open(std::string& error) override;
  bool poll(Goal& goal) override;
  std::string counters() const override { return target_.counters(); }

 private:
  /// A number of a message, and the target that it sets.
  struct StateSource {
    std::string joint;
    int field = 0;  // 0 position, 1 velocity
    std::size_t state = 0;
  };
  struct PoseTarget {
    std::size_t number = 0, target = 0;
    bool is_output = false;
  };

  const StateSource* find(const char* joint, int field) const;
  void take(const Ros2JointGoal& goal);
  bool take_joint(const Ros2JointGoal& goal, std::uint32_t joint, std::vector<double>& states);
  void take_pose(const double (&pose)[kRos2PoseNumbers]);

  const RobotFile& robot_;
  GoalTarget target_;
  std::vector<StateSource> sources_;
  std::vector<PoseTarget> pose_;
  Ros2GoalReader reader_;
};

}  // namespace tiller::tools
