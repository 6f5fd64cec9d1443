#include "executive/command_timeline.hpp"

#include <algorithm>

#include "safety/sensor_guard.hpp"

namespace tiller {

void CommandTimeline::lay_out(Arena& arena, std::uint32_t input_count) {
  ring_ = Ring<Entry>(arena.take<Entry>(kCapacity), kCapacity);
  nu_ = input_count;
}

void CommandTimeline::push(std::int64_t from_us, const double* command) {
  if (ring_.size() > 0) {
    Entry& newest = ring_[ring_.end() - 1];
    // a command that repeats costs no entry: polling far above the control rate must not push history out
    if (std::equal(command, command + nu_, newest.command)) return;
    from_us = std::max(from_us, newest.from_us);
    if (from_us == newest.from_us) {
      std::copy(command, command + nu_, newest.command);
      return;
    }
  }
  Entry& entry = ring_.push();
  entry.from_us = from_us;
  std::copy(command, command + nu_, entry.command);
}

void CommandTimeline::mean(std::int64_t reference_us, double from_s, double to_s, double* command) const {
  std::fill(command, command + nu_, 0.0);
  double covered_s = 0.0, end_s = to_s;
  for (std::uint64_t i = ring_.end(); i-- > ring_.begin();) {
    const Entry& entry = ring_[i];
    const double begin_s = static_cast<double>(elapsed_us(entry.from_us, reference_us)) * 1e-6;
    const bool last = begin_s <= from_s || i == ring_.begin();
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
