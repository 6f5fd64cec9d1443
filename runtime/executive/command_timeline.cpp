#include "executive/command_timeline.hpp"

#include <algorithm>
#include <limits>

#include "safety/sensor_guard.hpp"

namespace tiller {

void CommandTimeline::lay_out(Arena& arena, std::uint32_t input_count, std::int64_t window_us) {
  from_us_ = arena.take<std::int64_t>(kCapacity);
  command_ = arena.take<double>(std::size_t{kCapacity} * input_count);
  nu_ = input_count;
  window_us_ = window_us;
}

void CommandTimeline::push(std::int64_t from_us, const double* command) {
  if (count_ > 0) {
    double* const newest = this->command(count_ - 1);
    // a command that repeats costs no entry: polling far above the control rate must not push history out
    if (std::equal(command, command + nu_, newest)) return;
    from_us = std::max(from_us, from_us_[count_ - 1]);
    if (from_us == from_us_[count_ - 1]) {
      std::copy(command, command + nu_, newest);
      return;
    }
  }
  if (count_ == kCapacity) make_room(from_us);
  from_us_[count_] = from_us;
  std::copy(command, command + nu_, this->command(count_));
  ++count_;
}

void CommandTimeline::make_room(std::int64_t now_us) {
  const bool forgotten = elapsed_us(now_us, from_us_[1]) > window_us_;
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
    const std::int64_t span_us = elapsed_us(from_us_[i + 2], from_us_[i]);
    if (span_us >= shortest_us) continue;
    shortest_us = span_us;
    first = i;
  }
  const auto a_us = static_cast<double>(elapsed_us(from_us_[first + 1], from_us_[first]));
  const auto b_us = static_cast<double>(elapsed_us(from_us_[first + 2], from_us_[first + 1]));
  const double* const a = command(first);
  double* const b = command(first + 1);
  for (std::uint32_t k = 0; k < nu_; ++k) b[k] = (a_us * a[k] + b_us * b[k]) / (a_us + b_us);
  from_us_[first + 1] = from_us_[first];
  remove(first);
}

void CommandTimeline::remove(std::uint32_t at) {
  std::copy(from_us_ + at + 1, from_us_ + count_, from_us_ + at);
  std::copy(command(at + 1), command(count_), command(at));
  --count_;
}

void CommandTimeline::mean(std::int64_t reference_us, double from_s, double to_s, double* command) const {
  std::fill(command, command + nu_, 0.0);
  double covered_s = 0.0, end_s = to_s;
  for (std::uint32_t i = count_; i-- > 0;) {
    const double* const held = this->command(i);
    const double begin_s = static_cast<double>(elapsed_us(from_us_[i], reference_us)) * 1e-6;
    const bool last = begin_s <= from_s || i == 0;
    if (!last && begin_s >= end_s) continue;
    const double span_s = end_s - (last ? from_s : begin_s);
    // a lone command is returned as it stands: no rounding by a division
    if (last && covered_s == 0.0) {
      std::copy(held, held + nu_, command);
      return;
    }
    for (std::uint32_t k = 0; k < nu_; ++k) command[k] += span_s * held[k];
    covered_s += span_s;
    end_s = begin_s;
    if (last) break;
  }
  if (covered_s > 0.0)
    for (std::uint32_t k = 0; k < nu_; ++k) command[k] /= covered_s;
}

}  // namespace tiller
