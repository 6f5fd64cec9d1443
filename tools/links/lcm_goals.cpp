#include "tools/links/lcm_goals.hpp"

#include <cmath>
#include <cstring>

#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"

namespace tiller::tools {
namespace {

constexpr int kMostHandled = 64;  // a flood holds up no tick

}  // namespace

bool LcmGoals::open(std::string& error) {
  const TransportSection& transport = robot_.transport;
  if (!transport.key_file.empty()) {
    error = robot_.path +
            ": [transport] key_file asks for signed messages, and goals have no signature; name a CSV with "
            "--goals, or leave key_file out";
    return false;
  }
  UdpmUrl url;
  const char* wrong = is_udpm_url(transport.url.c_str()) ? parse_udpm_url(transport.url.c_str(), &url)
                                                         : "goals are read over udpm:// alone";
  OpenError problem;
  if (wrong != nullptr) {
    error = robot_.path + ": [transport] url = \"" + transport.url + "\": " + wrong;
    return false;
  }
  channel_ = transport.channel_prefix + "GOAL";
  if (has_multicast_route(transport.url.c_str(), &problem) &&
      socket_.open(url, channel_.c_str(), &problem) == tiller_status_ok)
    return true;
  error = robot_.path + ": goals over LCM: " + problem.text;
  return false;
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
  UdpDatagram datagram;
  for (int handled = 0; handled < kMostHandled && socket_.read(&datagram) == UdpRead::kDatagram; ++handled) {
    Lc02Packet packet;
    if (datagram.refusal != nullptr)
      refuse(datagram.refusal);
    else if (const char* why = lc02_parse(datagram.bytes, datagram.size, &packet))
      refuse(why);
    else if (channel_ == packet.channel)
      take(packet.message, packet.size);
  }
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
