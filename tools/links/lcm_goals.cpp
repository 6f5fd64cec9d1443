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

void LcmGoals::refuse(const char* why) {
  ++refused_;
  why_ = why;
}

void LcmGoals::take(const std::uint8_t* bytes, std::uint32_t size) {
  LcmGoal message{};
  if (!lcm_read(bytes, size, message)) return refuse("is no tiller_lcm.goal_t");
  if (message.sequence < 0 || message.sequence > std::int64_t{0xffffffff})
    return refuse("its sequence is outside 0..4294967295");
  if (message.sequence <= sequence_) return refuse("its sequence is not newer than the last one");
  if (message.kind != 0 && message.kind != 1) return refuse("its kind is neither 0 (states) nor 1 (outputs)");
  std::vector<double>& targets = message.kind == 0 ? now_.states : now_.outputs;
  if (targets.empty()) return refuse("the robot file weighs no outputs");
  if (message.count < 0 || static_cast<std::size_t>(message.count) != targets.size())
    return refuse("its count is not the number of the model's states, or outputs");
  for (std::size_t i = 0; i < targets.size(); ++i)
    if (!std::isnan(message.value[i]) && !(std::fabs(message.value[i]) <= TILLER_LARGEST_VALUE))
      return refuse("a value is infinite or too large");
  for (std::size_t i = 0; i < targets.size(); ++i)
    if (!std::isnan(message.value[i])) targets[i] = message.value[i];
  (message.kind == 0 ? states_changed_ : outputs_changed_) = true;
  sequence_ = message.sequence;
  ++taken_;
}

bool LcmGoals::poll(Goal& goal) {
  channel_.poll([this](const std::uint8_t* bytes, std::uint32_t size) { take(bytes, size); },
                [this](const char* why) { refuse(why); });
  if (!states_changed_ && !outputs_changed_) return false;
  goal = now_;
  if (!states_changed_) goal.states.clear();
  if (!outputs_changed_) goal.outputs.clear();
  states_changed_ = outputs_changed_ = false;
  return true;
}

std::string LcmGoals::counters() const {
  if (taken_ == 0 && refused_ == 0) return "";
  std::string text = format("goals: %llu taken", static_cast<unsigned long long>(taken_));
  if (refused_ > 0)
    text += format(", %llu refused, the last since %s", static_cast<unsigned long long>(refused_), why_);
  return text;
}

}  // namespace tiller::tools
