#pragma once

#include <cstdint>

#include "posterior/posterior.hpp"

namespace tiller {

/// Tells a robot that stands still from one that moves.
///
/// A model's errors are small beside its noise in one value and independent from one value to the next; at rest they
/// are neither. An encoder repeats itself to the last bit, friction holds what the model lets swing, and a process
/// noise that is not there is seen not to be there again and again: each tick at rest says the same thing once more,
/// and a likelihood that takes ten thousand of them for independent is sure of whatever fits best. So after kRestTicks
/// of rest further ticks count for nothing, until something moves.
///
/// Rest: no measured value has left the place where the count began by more than kMoved deviations of its sensor, no
/// input its level by more than kInputShare of its range. A tick is judged by those before it and by its input, not by
/// what it measures: to count the ticks alone in which something is seen to move would make the noise look larger than
/// it is.
class RestGuard {
 public:
  RestGuard() = default;
  explicit RestGuard(const tiller_config_t& config) : config_(&config) {}

  void begin() { still_ = 0; }
  /// Takes note of a transition; true if it counts for nothing.
  bool resting(const Transition& transition);

 private:
  /// Ticks at rest that count. They teach what a robot at rest can: that it stays where the model says.
  static constexpr std::uint32_t kRestTicks = 16;
  /// Noise alone gets there once in 1e5 ticks.
  static constexpr double kMoved = 6.0;
  static constexpr double kInputShare = 0.01;

  bool is_elsewhere(const Transition& transition) const;
  bool is_pushed(const Transition& transition) const;

  const tiller_config_t* config_ = nullptr;
  std::uint32_t still_ = 0;                     // ticks since the place was taken, saturating at kRestTicks
  double place_[TILLER_MAX_MEASUREMENTS] = {};  // NaN: not seen yet
  double input_[TILLER_MAX_INPUTS] = {};
};

}  // namespace tiller
