#pragma once

#include <algorithm>
#include <cstdint>

namespace tiller {

/// How many of the posterior's moves a tick pays for, where learning leaves a plan no time: a measurement is always
/// taken in, moves give way down to 8, the least that a configuration may ask for. With fewer, copies would crowd out
/// what is believed, and intervals become certain and wrong. Told by what a record tells, whether a plan completed an
/// iteration, so a replay gives the same number.
///
/// After a plan without one the moves are halved; after `wait` plans with one they get an eighth back. A try that fails
/// doubles the wait, up to an hour at 100 Hz; moves that are whole again end it.
class MovesGiven {
 public:
  void reset(std::uint32_t configured) {
    *this = MovesGiven();
    configured_ = configured;
  }
  /// A plan was made. Returns the moves of the next tick, a multiple of 8 as the configured number is.
  std::uint32_t after_plan(bool without_iteration) {
    if (without_iteration) {
      // late plans that no fewer moves can help say nothing of how many there is time for
      if (eighths_ > 1) wait_ = std::min(2 * wait_, kLongestWait);
      eighths_ = std::max(eighths_ / 2, std::uint32_t{1});
      calm_ = 0;
    } else if (eighths_ < 8 && ++calm_ >= wait_) {
      calm_ = 0;
      if (++eighths_ == 8) wait_ = kFirstWait;
    }
    return std::min(configured_, std::max(configured_ * eighths_ / 64 * 8, std::uint32_t{8}));
  }

 private:
  static constexpr std::uint32_t kFirstWait = 32, kLongestWait = 360000;
  std::uint32_t configured_ = 0, eighths_ = 8, calm_ = 0, wait_ = kFirstWait;
};

}  // namespace tiller
