#pragma once

#include <string>

#include "tools/links/goal_source.hpp"
#include "tools/links/lcm_channel.hpp"

namespace tiller::tools {

/// Goals from an LCM channel, <prefix>GOAL of [transport] (runtime/io/lcm/goal_t.lcm), whatever the robot itself is
/// reached by. What arrived between two ticks counts by its last message. Goals are not
/// signed: a robot file with a key_file refuses to listen.
class LcmGoals final : public GoalSource {
 public:
  explicit LcmGoals(const RobotFile& robot) : robot_(robot), target_(robot) {}
  LcmGoals(const LcmGoals&) = delete;
  LcmGoals& operator=(const LcmGoals&) = delete;

  bool open(std::string& error) override;
  bool poll(Goal& goal) override;
  std::string counters() const override { return target_.counters(); }
  /// Takes one encoded message, any bytes, as poll() does with what the channel brought.
  void take(const std::uint8_t* bytes, std::uint32_t size);

 private:
  const RobotFile& robot_;
  LcmChannel channel_;
  GoalTarget target_;
  std::int64_t sequence_ = -1;
};

}  // namespace tiller::tools
