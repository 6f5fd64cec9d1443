#pragma once

#include <vector>

namespace tiller::tools::gap {

/// A sensor's noise, from its readings alone.
struct NoiseEstimate {
  double sd = 0;    ///< NaN: too few readings
  double step = 0;  ///< of quantisation; 0: none seen
};

/// Standard deviation of white noise on readings (each inner vector evenly spaced, of one channel; NaN where missing):
/// the median of the periodogram's ordinates between 0.35 and 0.5 of the sampling rate, which movement hardly reaches
/// (at 9 readings a period it is at 0.11), under a Blackman-Harris window that keeps it from leaking there. The median
/// of an exponential is log 2 of its mean; a few ordinates with signal in them move it little. A quantised channel that
/// moves slowly has less noise there than its readings err: step / sqrt(12) is the least. Cost: 60 ns a reading.
NoiseEstimate estimate_noise(const std::vector<std::vector<double>>& readings);

}  // namespace tiller::tools::gap
