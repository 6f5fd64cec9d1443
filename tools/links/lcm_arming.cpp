#include "tools/links/lcm_arming.hpp"

#include <algorithm>
#include <utility>

#include "io/lcm_messages.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

constexpr std::int64_t kFresh_us = 1000000;  // a decision about the robot as it was longer ago is none about it now

}  // namespace

bool LcmArming::open(std::string& error) {
  return make_lcm_seal(robot_, seal_, error) && channel_.open(robot_, "ARM", "arm messages", error);
}

void LcmArming::note_sent(const tiller_command_t& command) {
  if (!sent_us_.empty() && command.stamp_us < sent_us_.back()) sent_us_.clear();  // the clock was set back
  sent_us_.push_back(command.stamp_us);
  while (command.stamp_us - sent_us_.front() > kFresh_us) sent_us_.pop_front();
}

bool LcmArming::is_of_this_run(std::int64_t stamp_us) const {
  return std::binary_search(sent_us_.begin(), sent_us_.end(), stamp_us);
}

void LcmArming::refuse(const char* why) {
  ++refused_;
  why_ = why;
}

void LcmArming::take(const std::uint8_t* bytes, std::uint32_t size) {
  std::vector<unsigned char> content(bytes, bytes + size);
  if (seal_.verify && !seal_.verify(channel_.name(), content)) {
    challenge_due_ = true;  // one that holds the key can answer it
    return refuse("it is not signed with the key, or answers no challenge");
  }
  LcmArm message{};
  if (!lcm_read(content.data(), static_cast<std::uint32_t>(content.size()), message))
    return refuse("it is no tiller_lcm.arm_t");
  if (message.arm != 0 && message.arm != 1) return refuse("its arm is neither 0 nor 1");
  if (!is_of_this_run(message.answered_stamp_us)) return refuse("it answers no command of this run's last second");
  if (message.answered_stamp_us <= answered_us_) return refuse("it is not newer than the last one");
  answered_us_ = message.answered_stamp_us;
  decided_ = message.arm != 0 ? ArmRequest::arm : ArmRequest::disarm;
  ++taken_;
}

ArmRequest LcmArming::poll() {
  channel_.poll([this](const std::uint8_t* bytes, std::uint32_t size) { take(bytes, size); },
                [this](const char* why) { refuse(why); });
  if (challenge_due_) {
    const std::string answer = channel_.name() + "_CHALLENGE";
    std::vector<unsigned char> trailer;
    seal_.sign(answer, trailer);
    channel_.send(answer, trailer.data(), static_cast<std::uint32_t>(trailer.size()));
    challenge_due_ = false;
  }
  return std::exchange(decided_, ArmRequest::none);
}

std::string LcmArming::help() const { return "a message arm_t on the LCM channel " + channel_.name(); }

std::string LcmArming::counters() const {
  if (taken_ == 0 && refused_ == 0) return "";
  std::string text = format("arm messages: %llu taken", static_cast<unsigned long long>(taken_));
  if (refused_ > 0)
    text += format(", %llu refused, the last since %s", static_cast<unsigned long long>(refused_), why_);
  return text;
}

}  // namespace tiller::tools
