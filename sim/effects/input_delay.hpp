#pragma once

#include <cmath>
#include <deque>

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// The motor does what it was told delay_s ago; nothing before that. Kept as changes, not as a grid, so the
/// delay is exact at every step and costs memory only when the command moves. A delay that is not a whole
/// number of steps ends at the next step.
class InputDelay final : public Effect {
 public:
  explicit InputDelay(double delay_s) : delay_us_(std::llround(delay_s * 1e6)) {}
  void reset() override {
    changes_.clear();
    now_ = last_ = 0;
  }
  double drive(double wanted, std::int64_t time_us, double) override {
    if (wanted != last_) changes_.push_back({time_us + delay_us_, wanted});
    last_ = wanted;
    for (; !changes_.empty() && changes_.front().due_us <= time_us; changes_.pop_front()) {
      now_ = changes_.front().force;
    }
    return now_;
  }

 private:
  struct Change {
    std::int64_t due_us;
    double force;
  };
  std::int64_t delay_us_;
  std::deque<Change> changes_;
  double now_ = 0;
  double last_ = 0;
};

}  // namespace tiller::sim
