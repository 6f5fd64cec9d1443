#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>

namespace tiller::sim {

/// From the sender's hand to the device's current set point: the line's latency, the device's memory of the
/// last command, its watchdog and its saturation.
class MotorLine {
 public:
  MotorLine(std::int64_t latency_us, std::int64_t timeout_us, double limit)
      : latency_us_(latency_us), timeout_us_(timeout_us), limit_(limit) {}

  void reset() {
    on_the_way_.clear();
    command_ = 0;
    armed_ = tripped_ = false;
    trips_ = 0;
  }

  void send(double command, std::int64_t time_us) {
    on_the_way_.push_back({time_us + latency_us_, std::clamp(command, -limit_, limit_)});
    deliver(time_us);
  }

  /// To be called at every instant before the command is read.
  void deliver(std::int64_t time_us) {
    for (; !on_the_way_.empty() && on_the_way_.front().arrives_us <= time_us; on_the_way_.pop_front()) {
      command_ = on_the_way_.front().command;
      fed_us_ = on_the_way_.front().arrives_us;
      armed_ = true;
      tripped_ = false;
    }
    if (armed_ && !tripped_ && timeout_us_ > 0 && time_us - fed_us_ >= timeout_us_) {
      tripped_ = true;
      ++trips_;
    }
  }

  double wanted() const { return tripped_ ? 0.0 : command_; }
  bool tripped() const { return tripped_; }
  std::uint64_t trips() const { return trips_; }

 private:
  struct Message {
    std::int64_t arrives_us;
    double command;
  };
  std::int64_t latency_us_;
  std::int64_t timeout_us_;
  double limit_;
  std::deque<Message> on_the_way_;
  double command_ = 0;
  std::int64_t fed_us_ = 0;
  bool armed_ = false;
  bool tripped_ = false;
  std::uint64_t trips_ = 0;
};

}  // namespace tiller::sim
