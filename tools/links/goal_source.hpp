#pragma once

#include <memory>
#include <string>

#include "tools/robot/goals.hpp"

namespace tiller::tools {

/// Goals from whoever sends them while the robot runs. Asked before every tick.
class GoalSource {
 public:
  virtual ~GoalSource() = default;
  /// False with a sentence and a remedy in `error`.
  virtual bool open(std::string& error) = 0;
  /// What has come since the last call: true, and the goal with the kinds that changed (the other list is empty).
  virtual bool poll(Goal& goal) = 0;
  /// "goals: 3 taken, 1 refused, the last since ..."; empty where nothing came.
  virtual std::string counters() const = 0;
};

/// By the word of --goals, "lcm" or "ros2"; null for every other word, which names a file.
std::unique_ptr<GoalSource> make_goal_source(const std::string& word, const RobotFile& robot);

/// Every target in force, and what has changed of it: what such sources have in common.
class GoalTarget {
 public:
  explicit GoalTarget(const RobotFile& robot) : now_(goal_of(robot)) {}

  std::vector<double>& states() { return now_.states; }
  std::vector<double>& outputs() { return now_.outputs; }
  void take(bool states, bool outputs);
  void refuse(const std::string& why);
  bool poll(Goal& goal);
  std::string counters() const;

 private:
  Goal now_;
  bool states_changed_ = false, outputs_changed_ = false;
  std::uint64_t taken_ = 0, refused_ = 0;
  std::string why_;  // it was refused last
};

}  // namespace tiller::tools
