#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/ring.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Which command was really in force when. A command holds from the moment it took effect (send time plus
/// latency) until the next one does, whatever the nominal period was: late ticks, missed measurements and
/// latency all become the same question, the mean command over an interval of true time.
class CommandTimeline {
 public:
  /// Enough for the longest delay and four missed periods at two commands a period.
  static constexpr std::uint32_t kCapacity = 64;

  void lay_out(Arena& arena, std::uint32_t input_count);

  /// Forgets all commands: a stamp from a clock that went wrong would hold back every later one.
  void clear() { ring_.clear(); }

  /// `command` (nu) holds from `from_us` on. A moment before that of the newest command counts as the
  /// newest's: commands do not overtake one another on their way to the motor.
  void push(std::int64_t from_us, const double* command);

  /// Mean command (nu) over [from_s, to_s] relative to `reference_us`; the value at to_s if the interval is
  /// empty. Before the oldest command known: as the oldest. Zero if nothing was ever pushed. Cost:
  /// O(kCapacity).
  void mean(std::int64_t reference_us, double from_s, double to_s, double* command) const;

 private:
  struct Entry {
    std::int64_t from_us;
    double command[TILLER_MAX_INPUTS];
  };
  Ring<Entry> ring_;
  std::uint32_t nu_ = 0;
};

}  // namespace tiller
