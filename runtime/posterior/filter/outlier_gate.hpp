#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "posterior/filter/particles.hpp"

namespace tiller {

/// A measured value that is beyond kGate deviations for every particle is a glitch: it is treated as missing, here and
/// in every later rerun. One particle that can explain it makes it data.
class OutlierGate {
 public:
  void begin() { std::fill(run_, run_ + TILLER_MAX_MEASUREMENTS, 0u); }
  /// After the prediction: values that no particle explains become NaN. True if nothing is left of a measurement.
  bool refuse(const LaneFilter& filter, const FilterChunk* chunks, const Cloud& cloud, double noise_scale,
              double* measured);
  std::uint64_t refused() const { return refused_; }

  static bool explains(const LaneFilter& filter, const FilterChunk& chunk, std::uint32_t lane, const double* measured,
                       std::uint32_t k, double noise_scale) {
    const LaneFilter::Residual r = filter.residual(chunk, lane, measured, k);
    const double scale = std::fmax(1.0, noise_scale * noise_scale);
    return r.error * r.error <= kGate * kGate * scale * r.variance;
  }

 private:
  /// A normal innovation never gets there; what does is a glitch of the sensor.
  static constexpr double kGate = 8.0;
  /// Outliers in a row after which a measurement is believed after all: then the world has changed, not the sensor.
  static constexpr std::uint32_t kRun = 5;

  std::uint32_t run_[TILLER_MAX_MEASUREMENTS] = {};  // outliers in a row
  std::uint64_t refused_ = 0;
};

}  // namespace tiller
