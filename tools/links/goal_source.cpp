#include "tools/links/goal_source.hpp"

#include "tools/links/lcm_goals.hpp"
#include "tools/links/ros2_goals.hpp"

namespace tiller::tools {

std::unique_ptr<GoalSource> make_goal_source(const std::string& word, const RobotFile& robot) {
  if (word == "lcm") return std::make_unique<LcmGoals>(robot);
  if (word == "ros2") return std::make_unique<Ros2Goals>(robot);
  return nullptr;
}

void GoalTarget::take(bool states, bool outputs) {
  states_changed_ = states_changed_ || states;
  outputs_changed_ = outputs_changed_ || outputs;
  ++taken_;
}

void GoalTarget::refuse(const std::string& why) {
  ++refused_;
  why_ = why;
}

bool GoalTarget::poll(Goal& goal) {
  if (!states_changed_ && !outputs_changed_) return false;
  goal = now_;
  if (!states_changed_) goal.states.clear();
  if (!outputs_changed_) goal.outputs.clear();
  states_changed_ = outputs_changed_ = false;
  return true;
}

std::string GoalTarget::counters() const {
  if (taken_ == 0 && refused_ == 0) return "";
  std::string text = format("goals: %llu taken", static_cast<unsigned long long>(taken_));
  if (refused_ > 0)
    text += format(", %llu refused, the last since %s", static_cast<unsigned long long>(refused_), why_.c_str());
  return text;
}

}  // namespace tiller::tools
