#include "tools/identify/identify_noise.hpp"

#include <algorithm>
#include <cmath>

#include "tools/identify/lane_filter.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kFactors = kLanePadding;  // one a lane
constexpr std::uint64_t kFewestValues = 100;  // less tell process from sensor noise to no better than a factor of two

}  // namespace

double estimate_process_scale(const tiller_config_t& config, const std::vector<double>& params, double noise_scale,
                              const std::vector<Stretch>& stretches) {
  LaneFilter filter(config, kFactors);
  for (std::uint32_t l = 0; l < kFactors; ++l) {
    filter.process_variance()[l] = std::ldexp(1.0, -static_cast<int>(l));
    for (std::size_t i = 0; i < params.size(); ++i) filter.params()[i * kFactors + l] = params[i];
  }
  double squared_error[kFactors] = {}, log_variance[kFactors] = {};
  std::uint64_t values = 0;
  for (const Stretch& stretch : stretches) {
    filter.begin(stretch.start);
    for (const Transition& step : stretch.steps) filter.step(step, noise_scale);
    for (std::uint32_t l = 0; l < kFactors; ++l) {
      squared_error[l] += filter.squared_error(l);
      log_variance[l] += filter.log_variance(l);
    }
    values += filter.values();
  }
  if (values < kFewestValues) return 1.0;
  const double shape = config.posterior.noise_scale_shape;
  double likelihood[kFactors], largest = -INFINITY;
  for (std::uint32_t l = 0; l < kFactors; ++l) {
    likelihood[l] =
        -(shape + 0.5 * static_cast<double>(values)) * std::log(shape + 0.5 * squared_error[l]) - 0.5 * log_variance[l];
    if (std::isfinite(likelihood[l])) largest = std::max(largest, likelihood[l]);
  }
  double weight = 0, square = 0;
  for (std::uint32_t l = 0; l < kFactors; ++l) {
    if (!std::isfinite(likelihood[l])) continue;
    // nodes even in the logarithm, a prior even in the factor itself: data that show no process noise at all leave it
    // room up to where they would show it
    const double w = std::sqrt(filter.process_variance()[l]) * std::exp(likelihood[l] - largest);
    weight += w;
    square += w * filter.process_variance()[l];
  }
  return weight > 0 ? std::sqrt(square / weight) : 1.0;
}

}  // namespace tiller::tools
