#include "executive/command_timeline.hpp"

#include <algorithm>
#include <limits>

#include "safety/sensor_guard.hpp"

namespace tiller {

void CommandTimeline::lay_out(Arena& arena, std::uint32_t input_count, std::int64_t window_us) {
  entry_ = arena.take<Entry>(kCapacity);
  nu_ = input_count;
  window_us_ = window_us;
}

void CommandTimeline::push(std::int64_t from_us, const double* command) {
  if (count_ > 0) {
    Entry& newest = entry_[count_ - 1];
    // a command that repeats costs no entry: polling far above the control rate must not push history out
    if (std::equal(command, command + nu_, newest.command)) return;
    from_us = std::max(from_us, newest.from_us);
    if (from_us == newest.from_us) {
      std::copy(command, command + nu_, newest.command);
      return;
    }
  }
  if (count_ == kCapacity) make_room(from_us);
  Entry& entry = entry_[count_++];
  entry.from_us = from_us;
  std::copy(command, command + nu_, entry.command);
}

void CommandTimeline::make_room(std::int64_t now_us) {
  const bool forgotten = elapsed_us(now_us, entry_[1].from_us) > window_us_;
  if (forgotten)
    remove(0);
  else
    merge_shortest_pair();
}

/// The newest command takes no part: nobody knows yet how long it holds. Of equals the oldest pair, so that the newest
/// commands stay as they were sent for longest.
void CommandTimeline::merge_shortest_pair() {
  std::uint32_t first = 0;
  std::int64_t shortest_us = std::numeric_limits<std::int64_t>::max();
  for (std::uint32_t i = 0; i + 2 < count_; ++i) {
    const std::int64_t span_us = elapsed_us(entry_[i + 2].from_us, entry_[i].from_us);
    if (span_us >= shortest_us) continue;
    shortest_us = span_us;
    first = i;
  }
  Entry &a = entry_[first], &b = entry_[first + 1];
  const auto a_us = static_cast<double>(elapsed_us(b.from_us, a.from_us));
  const auto b_us = static_cast<double>(elapsed_us(entry_[first + 2].from_us, b.from_us));
  for (std::uint32_t k = 0; k < nu_; ++k) b.command[k] = (a_us * a.command[k] + b_us * b.command[k]) / (a_us + b_us);
  b.from_us = a.from_us;
  remove(first);
}

void CommandTimeline::remove(std::uint32_t at) {
  std::copy(entry_ + at + 1, entry_ + count_, entry_ + at);
  --count_;
}

void CommandTimeline::mean(std::int64_t reference_us, double from_s, double to_s, double* command) const {
  std::fill(command, command + nu_, 0.0);
  double covered_s = 0.0, end_s = to_s;
  for (std::uint32_t i = count_; i-- > 0;) {
    const Entry& entry = entry_[i];
    const double begin_s = static_cast<double>(elapsed_us(entry.from_us, reference_us)) * 1e-6;
    const bool last = begin_s <= from_s || i == 0;
    if (!last && begin_s >= end_s) continue;
    const double span_s = end_s - (last ? from_s : begin_s);
    // a lone command is returned as it stands: no rounding by a division
    if (last && covered_s == 0.0) {
      std::copy(entry.command, entry.command + nu_, command);
      return;
    }
    for (std::uint32_t k = 0; k < nu_; ++k) command[k] += span_s * entry.command[k];
    covered_s += span_s;
    end_s = begin_s;
    if (last) break;
  }
  if (covered_s > 0.0)
    for (std::uint32_t k = 0; k < nu_; ++k) command[k] /= covered_s;
}

}  // namespace tiller
