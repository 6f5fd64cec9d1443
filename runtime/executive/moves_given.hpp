#pragma once

#include <algorithm>
#include <cstdint>

namespace tiller {

/// How many of the posterior's moves a tick pays for, where learning leaves a plan no time: a measurement is always
/// taken in, moves give way. Told by what a record tells, whether a plan completed an iteration, so a replay gives the
/// same number.
///
/// After a plan without one the moves are halved; after `wait` plans with one they get an eighth back. A try that fails
/// doubles the wait, up to an hour at 100 Hz; moves that are whole again end it. Where none are left, every kTurn-th tick
/// has the least number, at the price of its plan: particles that are only weighed and copied become one.
class MovesGiven {
 public:
  void reset(std::uint32_t configured) {
    *this = MovesGiven();
    configured_ = configured;
  }
  /// A plan was made. Returns the moves of the next tick: a multiple of 8 as the configured number is, or 1, for which
  /// engines do none and yet keep what moves are judged by.
  std::uint32_t after_plan(bool without_iteration) {
    const bool was_a_turn = turn_ == kTurn;
    turn_ = was_a_turn ? 0 : turn_ + 1;
    if (without_iteration && !was_a_turn) {
      eighths_ /= 2;
      calm_ = 0;
      wait_ = std::min(2 * wait_, kLongestWait);
    } else if (eighths_ < 8 && ++calm_ >= wait_) {
      calm_ = 0;
      if (++eighths_ == 8) wait_ = kFirstWait;
    }
    const std::uint32_t moves = configured_ * eighths_ / 64 * 8, least = turn_ == kTurn ? 8 : 1;
    return std::min(configured_, std::max(moves, least));
  }

 private:
  static constexpr std::uint32_t kFirstWait = 32, kLongestWait = 360000, kTurn = 16;
  std::uint32_t configured_ = 0, eighths_ = 8, calm_ = 0, wait_ = kFirstWait, turn_ = 0;
};

}  // namespace tiller
