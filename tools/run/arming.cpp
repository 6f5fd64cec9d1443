#include "tools/run/arming.hpp"

namespace tiller::tools {

std::string Arming::help() const {
  std::string text;
  for (const ArmSource* source : sources_)
    if (const std::string how = source->help(); !how.empty()) text += (text.empty() ? "" : ", ") + how;
  return text;
}

ArmRequest Arming::ask() {
  ArmRequest asked = ArmRequest::none;
  for (ArmSource* source : sources_) {
    const ArmRequest request = source->poll();
    if (asked != ArmRequest::disarm && request != ArmRequest::none) asked = request;
  }
  return asked;
}

void Arming::get_ready() {
  wanted_ = true;
  link_.permit();
  link_.prepare(true);
}

std::string Arming::begin() {
  const bool early = ask() == ArmRequest::arm;
  if (at_once_) {
    get_ready();
    return "";
  }
  const std::string how = help();
  return std::string(early ? "what was decided before the first measurement does not arm\n" : "") +
         "STANDBY: nothing moves. " +
         (how.empty() ? "Nothing can arm this run: there is no terminal on its input; --arm arms at the start"
                      : "To arm: " + how + "; --arm arms at the start");
}

std::string Arming::disarm(tiller_t* controller) {
  if (!wanted_ && !armed_) return "";
  wanted_ = armed_ = false;
  (void)tiller_disarm(controller);
  link_.prepare(false);
  return "disarmed: STANDBY, the safe command is being sent";
}

std::string Arming::arm_when_ready(tiller_t* controller) {
  if (!wanted_ || armed_ || !link_.is_ready()) return "";
  armed_ = tiller_arm(controller) == tiller_status_ok;
  if (!armed_) return "";
  wanted_ = false;
  begins_ = !at_once_ || ever_;
  ever_ = true;
  return begins_ ? "armed" : "";
}

std::string Arming::step(tiller_t* controller, const tiller_info_t& info) {
  begins_ = false;
  const ArmRequest asked = ask();
  if (info.state == tiller_state_safe) {
    wanted_ = armed_ = false;
    return asked == ArmRequest::arm ? "not armed: SAFE is left by a new start alone" : "";
  }
  if (asked == ArmRequest::disarm) return disarm(controller);
  std::string told;
  if (asked == ArmRequest::arm && !wanted_ && !armed_) {
    if (info.state != tiller_state_standby) return "not armed: there is no valid measurement yet";
    get_ready();
    if (!link_.is_ready()) told = "arming: the drives get ready";
  }
  const std::string done = arm_when_ready(controller);
  return done.empty() ? told : done;
}

}  // namespace tiller::tools
