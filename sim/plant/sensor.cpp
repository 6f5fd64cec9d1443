#include "sim/plant/sensor.hpp"

#include <cmath>

namespace tiller::sim {

void StateHistory::reset(const std::vector<double>& state) {
  entries_.clear();
  entries_.push_back({0, state});
}

void StateHistory::push(std::int64_t time_us, const std::vector<double>& state) {
  // in the usual case the oldest entry goes as the new one comes: its memory is used again
  const bool full = entries_.size() > 2 && entries_[1].time_us <= time_us - span_us_;
  if (full) {
    Entry old = std::move(entries_.front());
    entries_.pop_front();
    old.time_us = time_us;
    old.state.assign(state.begin(), state.end());
    entries_.push_back(std::move(old));
  } else {
    entries_.push_back({time_us, state});
  }
  // keep one entry at or before the start of the span, to interpolate from
  while (entries_.size() > 2 && entries_[1].time_us <= time_us - span_us_) entries_.pop_front();
}

void StateHistory::at(std::int64_t time_us, std::vector<double>& out) const {
  std::size_t after = entries_.size() - 1;
  while (after > 0 && entries_[after - 1].time_us >= time_us) --after;
  const Entry& b = entries_[after];
  out = b.state;
  if (after == 0 || b.time_us <= time_us) return;
  const Entry& a = entries_[after - 1];
  const double part = static_cast<double>(time_us - a.time_us) / static_cast<double>(b.time_us - a.time_us);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = a.state[i] + part * (b.state[i] - a.state[i]);
}

double Encoder::read(double truth, std::int64_t sampled_us) const {
  double value = truth;
  if (noise_sd > 0) value += noise_sd * noise.normal(static_cast<std::uint64_t>(sampled_us));
  if (step > 0) value = step * std::round(value / step);
  return value;
}

}  // namespace tiller::sim
