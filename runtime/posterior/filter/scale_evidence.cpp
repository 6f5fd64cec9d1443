#include "posterior/filter/scale_evidence.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

ScaleEvidence::ScaleEvidence(const tiller_config_t& config) : configured_a0_(config.posterior.noise_scale_shape) {
  believe_configuration();
}

void ScaleEvidence::believe(double variance, double values) {
  a0_ = 0.5 * values;
  b0_ = a0_ * variance;
}

void ScaleEvidence::log_likelihood(std::uint32_t lanes, const double* sums, std::uint32_t stride, double* out) const {
  const double *squared = sums + kSquared * stride, *logs = sums + kLogs * stride;
  for (std::uint32_t l = 0; l < lanes; ++l) {
    // rounding leaves a little less than nothing; much less, and an approximate past has been left behind
    const double half = squared[l] < 0.0 ? (squared[l] < -b0_ ? NAN : 0.0) : 0.5 * squared[l];
    out[l] = -exponent() * math::log(b0_ + half) - 0.5 * logs[l];
  }
}

double ScaleEvidence::variance(double squared_error) const {
  // the mean exists from shape 1 on; before that the ratio of the two stands in its place
  const double shape = exponent();
  return (b0_ + 0.5 * std::fmax(0.0, squared_error)) / (shape > 2.0 ? shape - 1.0 : shape);
}

}  // namespace tiller
