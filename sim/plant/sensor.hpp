#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "sim/mechanisms/noise.hpp"

namespace tiller::sim {

/// The last states, so that a sensor can show the plant as it was. Linear between physics steps.
class StateHistory {
 public:
  /// How far back it reaches from the newest state.
  void keep(std::int64_t span_us) { span_us_ = span_us; }
  void reset(const std::vector<double>& state);
  void push(std::int64_t time_us, const std::vector<double>& state);
  /// State at time_us; the first known one for times before it.
  void at(std::int64_t time_us, std::vector<double>& out) const;

 private:
  struct Entry {
    std::int64_t time_us;
    std::vector<double> state;
  };
  std::int64_t span_us_ = 0;
  std::deque<Entry> entries_;
};

/// One encoder: truth + white noise, then rounded to the nearest mark of its disc.
struct Encoder {
  double noise_sd = 0;
  double step = 0;  ///< 0: no quantisation
  NoiseStream noise;
  /// The noise belongs to the sampling instant: reading twice at one time gives one value.
  double read(double truth, std::int64_t sampled_us) const;
};

}  // namespace tiller::sim
