#pragma once

#include <algorithm>
#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Whether somebody has just begun, or stopped, to push: a force that comes from one period to the next, which a
/// posterior that has found the world still would put down to the parameters.
///
/// Page's test (Page, "Continuous inspection schemes", Biometrika 41, 1954) of the log ratio by which a filter that
/// expects such forces at any time predicts the readings better than the particles do. Beyond kSuspect the ticks are
/// under suspicion; beyond kShove they were a shove, and what they said of the parameters is taken back. A world that
/// the particles describe reaches kShove less than once in exp(kShove) ticks.
class ShoveWatch {
 public:
  enum class Verdict : std::uint8_t { calm, suspicious, shoved };

  /// Ticks that a shove may take to show; all of them stay in the window. 0 for a posterior that does not move: it has
  /// no parameters that a shove could spoil.
  static std::uint32_t longest(const tiller_config_t& config) {
    const tiller_posterior_config_t& c = config.posterior;
    return c.enabled && c.moves_per_tick > 0 ? std::min(kLongest, c.window / 2) : 0;
  }
  /// No suspicion is longer than `longest` ticks; 0: there is none ever.
  void reset(std::uint32_t longest) {
    longest_ = longest;
    credit_ = kMost;
    begin();
  }
  void begin() {
    sum_ = 0.0;
    ticks_ = 0;
  }
  bool suspects() const { return ticks_ > 0; }
  bool may_find() const { return longest_ > 0; }
  Verdict take(double log_ratio) {
    credit_ = credit_ < kMost ? credit_ + kCredit : kMost;
    const double sum = sum_ + log_ratio;
    sum_ = sum > 0.0 ? sum : 0.0;
    if (!(sum_ > kSuspect) || longest_ == 0 || ticks_ == longest_) {
      begin();
      return Verdict::calm;
    }
    ++ticks_;
    if (sum_ < kShove || ticks_ < kFewest) return Verdict::suspicious;
    begin();
    if (credit_ < 1.0) return Verdict::calm;
    credit_ -= 1.0;
    return Verdict::shoved;
  }

 private:
  static constexpr double kSuspect = 1.0, kShove = 8.0;
  /// One reading alone, or two, may be the sensor's: the one after them tells, which a shove still moves.
  static constexpr std::uint32_t kFewest = 2, kLongest = 20;
  /// Shoves that may follow one another, and that a tick earns: where forces go on to come and go, the posterior learns
  /// how large they are and how fast, for which it has to see them.
  static constexpr double kMost = 4.0, kCredit = 1.0 / 128.0;

  double sum_ = 0.0, credit_ = kMost;
  std::uint32_t ticks_ = 0, longest_ = 0;
};

}  // namespace tiller
