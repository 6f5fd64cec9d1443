#pragma once

#include <cstdint>

#include "sim/servers/serve.hpp"

namespace tiller::sim {

/// The device's other watchdog: commands that keep coming do not prove that anybody still thinks. A thread that
/// repeats the last command, or a controller whose planner hangs, sends for ever.
///
/// In ACTIVE the plan's number must grow; in HOLD, where nothing is planned, the number of the answered measurement.
/// A sender that counts neither (a script, a bench tool) is not watched. Any change counts as growth, so that a number
/// of few bits will do.
class PlanWatch {
 public:
  explicit PlanWatch(std::int64_t timeout_us) : timeout_us_(timeout_us) {}

  /// A command, or the controller's status about one, at the device's time.
  void note(const PlantCommand& command, std::int64_t time_us) {
    if (command.plan == PlantCommand::kUnnumbered) return;
    const bool moving = command.state == kActive || command.state == kHold;
    const std::int64_t proof = command.state == kHold ? command.sequence : command.plan;
    if (!moving || command.state != state_ || proof != proof_) fresh_us_ = time_us;
    state_ = command.state;
    proof_ = proof;
    watched_ = moving;
  }
  /// Commands from now on are not obeyed and do not feed the motor's watchdog.
  bool hung(std::int64_t time_us) const { return timeout_us_ > 0 && watched_ && time_us - fresh_us_ >= timeout_us_; }

 private:
  static constexpr std::int32_t kActive = 2, kHold = 3;

  std::int64_t timeout_us_;
  bool watched_ = false;
  std::int32_t state_ = -1;
  std::int64_t proof_ = -1;
  std::int64_t fresh_us_ = 0;
};

}  // namespace tiller::sim
