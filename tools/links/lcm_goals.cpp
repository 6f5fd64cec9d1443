#include "tools/links/lcm_goals.hpp"

#include <cmath>

#include "io/lcm_messages.hpp"

namespace tiller::tools {

bool LcmGoals::open(std::string& error) {
  const TransportSection& transport = robot_.transport;
  if (!transport.key_file.empty()) {
    error = robot_.path +
            ": [transport] key_file asks for signed messages, and goals have no signature; name a CSV with "
            "--goals, or leave key_file out";
    return false;
  }
  return channel_.open(robot_, "GOAL", "goals", error);
}

void LcmGoals::take(const std::uint8_t* bytes, std::uint32_t size) {
  LcmGoal message{};
  if (!lcm_read(bytes, size, message)) return target_.refuse("is no tiller_lcm.goal_t");
  if (message.sequence < 0 || message.sequence > std::int64_t{0xffffffff})
    return target_.refuse("its sequence is outside 0..4294967295");
  if (message.sequence <= sequence_) return target_.refuse("its sequence is not newer than the last one");
  if (message.kind != 0 && message.kind != 1) return target_.refuse("its kind is neither 0 (states) nor 1 (outputs)");
  std::vector<double>& targets = message.kind == 0 ? target_.states() : target_.outputs();
  if (targets.empty()) return target_.refuse("the robot file weighs no outputs");
  if (message.count < 0 || static_cast<std::size_t>(message.count) != targets.size())
    return target_.refuse("its count is not the number of the model's states, or outputs");
  for (std::size_t i = 0; i < targets.size(); ++i)
    if (!std::isnan(message.value[i]) && !(std::fabs(message.value[i]) <= TILLER_LARGEST_VALUE))
      return target_.refuse("a value is infinite or too large");
  for (std::size_t i = 0; i < targets.size(); ++i)
    if (!std::isnan(message.value[i])) targets[i] = message.value[i];
  sequence_ = message.sequence;
  target_.take(message.kind == 0, message.kind == 1);
}

bool LcmGoals::poll(Goal& goal) {
  channel_.poll([this](const std::uint8_t* bytes, std::uint32_t size) { take(bytes, size); },
                [this](const char* why) { target_.refuse(why); });
  return target_.poll(goal);
}

}  // namespace tiller::tools
