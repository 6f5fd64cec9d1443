#pragma once

#include <cstddef>
#include <cstdint>

#include "core/arena.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Which command was really in force when. A command holds from the moment it took effect (send time plus
/// latency) until the next one does, whatever the nominal period was: late ticks, missed measurements and
/// latency all become the same question, the mean command over an interval of true time.
///
/// A caller that ticks far above the control rate sends more commands within the longest delay than there are
/// entries. Commands older than the window are then forgotten first; within it the two neighbours that held for the
/// shortest time together become one, their mean: nothing in the window goes unrepresented, and no mean over an
/// interval that begins and ends between entries changes.
class CommandTimeline {
 public:
  /// Every command of the longest window (41 periods) at one command and a half a period.
  static constexpr std::uint32_t kCapacity = 64;

  /// `window_us`: how far back from the newest command mean() is asked.
  void lay_out(Arena& arena, std::uint32_t input_count, std::int64_t window_us);

  /// Forgets all commands: a stamp from a clock that went wrong would hold back every later one.
  void clear() { count_ = 0; }

  /// `command` (nu) holds from `from_us` on. A moment before that of the newest command counts as the
  /// newest's: commands do not overtake one another on their way to the motor. Cost: O(kCapacity).
  void push(std::int64_t from_us, const double* command);

  /// Mean command (nu) over [from_s, to_s] relative to `reference_us`; the value at to_s if the interval is
  /// empty. Before the oldest command known: as the oldest. Zero if nothing was ever pushed. Cost:
  /// O(kCapacity).
  void mean(std::int64_t reference_us, double from_s, double to_s, double* command) const;

 private:
  void make_room(std::int64_t now_us);
  void merge_shortest_pair();
  void remove(std::uint32_t at);

  double* command(std::uint32_t at) const { return command_ + std::size_t{at} * nu_; }

  std::int64_t* from_us_ = nullptr;  // (kCapacity) oldest first
  double* command_ = nullptr;        // (kCapacity x nu)
  std::uint32_t count_ = 0;
  std::uint32_t nu_ = 0;
  std::int64_t window_us_ = 0;
};

}  // namespace tiller
