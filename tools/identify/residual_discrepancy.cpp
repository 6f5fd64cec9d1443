#include "tools/identify/residual_discrepancy.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {

ResidualDiscrepancy::ResidualDiscrepancy(const MethodProblem& problem, const Coordinates& coordinates,
                                         const std::vector<Episode>& episodes, const DiscrepancyForm& form)
    : Discrepancy(problem, coordinates, episodes, form), weight_l1_(form.weight_l1), weight_l2_(form.weight_l2) {
  for (std::uint32_t r = 0; r < state_count(); ++r) scale_.push_back(form.scale ? displacement_scale(r) : 1.0);
  make_filter(form.smoothing_steps);
}

void ResidualDiscrepancy::make_filter(double smoothing_steps) {
  filter_.assign(1, 1.0);
  if (!(smoothing_steps > 0)) return;
  const auto reach = static_cast<std::size_t>(std::ceil(3 * smoothing_steps));
  for (std::size_t k = 1; k <= reach; ++k) {
    const double z = static_cast<double>(k) / smoothing_steps;
    filter_.push_back(std::exp(-0.5 * z * z));
  }
}

// error_ of one state along the span, scaled; rows of lanes.
void ResidualDiscrepancy::errors_of(const RolloutSpan& span, std::uint32_t state, const double* trajectory) {
  const std::uint32_t nx = state_count();
  const bool angle = (config_.model->angle_mask >> state) & 1u;
  error_.resize(span.steps * kLanes);
  measured_.assign(span.steps, 0);
  for (std::size_t k = 1; k <= span.steps; ++k) {
    const double measured = span.episode->at(span.start + k)[state];
    if (!std::isfinite(measured)) continue;
    measured_[k - 1] = 1;
    const double* row = trajectory + (k * nx + state) * kLanes;
    double* error = error_.data() + (k - 1) * kLanes;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      double e = row[lane] - measured;
      if (angle && std::fabs(e) > 3.141592653589793) e = std::remainder(e, 6.283185307179586);
      error[lane] = scale_[state] * e;
    }
  }
}

void ResidualDiscrepancy::smooth(std::size_t steps) {
  smoothed_.assign(steps * kLanes, 0.0);
  const auto reach = static_cast<std::ptrdiff_t>(filter_.size()) - 1, last = static_cast<std::ptrdiff_t>(steps) - 1;
  for (std::ptrdiff_t k = 0; k <= last; ++k) {
    double* out = smoothed_.data() + static_cast<std::size_t>(k) * kLanes;
    double sum = 0;
    for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, k - reach); j <= std::min(last, k + reach); ++j) {
      const auto row = static_cast<std::size_t>(j);
      if (!measured_[row]) continue;
      const double tap = filter_[static_cast<std::size_t>(std::abs(j - k))];
      sum += tap;
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) out[lane] += tap * error_[row * kLanes + lane];
    }
    for (std::uint32_t lane = 0; sum > 0 && lane < kLanes; ++lane) out[lane] /= sum;
  }
  error_.swap(smoothed_);
}

void ResidualDiscrepancy::begin() { std::fill(std::begin(sum_), std::end(sum_), 0.0); }

void ResidualDiscrepancy::add(const RolloutSpan& span, const double* trajectory) {
  for (std::uint32_t r = 0; r < state_count(); ++r) {
    if (scale_[r] == 0) continue;
    errors_of(span, r, trajectory);
    if (filter_.size() > 1) smooth(span.steps);
    for (std::size_t k = 0; k < span.steps; ++k) {
      if (!measured_[k]) continue;
      const double* error = error_.data() + k * kLanes;
      for (std::uint32_t lane = 0; lane < kLanes; ++lane)
        sum_[lane] += weight_l1_ * std::fabs(error[lane]) + weight_l2_ * error[lane] * error[lane];
    }
  }
}

}  // namespace tiller::tools
