#pragma once

#include <string>

#include "tools/links/lcm_channel.hpp"
#include "tools/robot/goals.hpp"

namespace tiller::tools {

/// Goals from an LCM channel, <prefix>GOAL of [transport] (runtime/io/lcm/goal_t.lcm), whatever the robot itself is
/// reached by. What arrived between two ticks counts by its last message. Goals are not
/// signed: a robot file with a key_file refuses to listen.
class LcmGoals {
 public:
  explicit LcmGoals(const RobotFile& robot) : robot_(robot), now_(goal_of(robot)) {}
  LcmGoals(const LcmGoals&) = delete;
  LcmGoals& operator=(const LcmGoals&) = delete;

  /// False with a sentence and a remedy in `error`.
  bool open(std::string& error);
  /// What has come since the last call: true, and the goal with the kinds that changed (the other list is empty).
  bool poll(Goal& goal);
  /// ", 3 goals, 1 refused: why"; empty where nothing came.
  std::string counters() const;

 private:
  void take(const std::uint8_t* bytes, std::uint32_t size);
  void refuse(const char* why);

  const RobotFile& robot_;
  LcmChannel channel_;
  Goal now_;  // every target in force
  bool states_changed_ = false, outputs_changed_ = false;
  std::int64_t sequence_ = -1;
  std::uint64_t taken_ = 0, refused_ = 0;
  const char* why_ = nullptr;  // it was refused last
};

}  // namespace tiller::tools
