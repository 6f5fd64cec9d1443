#include "tools/identify/discrepancy.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tiller::tools {

Discrepancy::Discrepancy(const MethodProblem& problem, const Coordinates& coordinates,
                         const std::vector<Episode>& episodes, std::size_t steps, double smoothing_steps)
    : config_(*problem.config),
      coordinates_(coordinates),
      rollout_(*problem.config, kLanes),
      spans_(make_spans(episodes, steps)),
      weight_l1_(problem.options.weight_l1),
      weight_l2_(problem.options.weight_l2) {
  scale_by_displacement();
  make_filter(smoothing_steps);
}

void Discrepancy::scale_by_displacement() {
  const tiller_model_t& model = *config_.model;
  scale_.assign(model.state_count, 0.0);
  for (std::uint32_t r = 0; r < model.state_count; ++r) {
    double square = 0, count = 0;
    for (const RolloutSpan& span : spans_)
      for (std::size_t k = 1; k <= span.steps; ++k) {
        const double d =
            state_difference(model, r, span.episode->at(span.start + k)[r], span.episode->at(span.start)[r]);
        if (!std::isfinite(d)) continue;
        square += d * d;
        count += 1;
      }
    if (square > 0) scale_[r] = std::sqrt(count / square);
  }
  for (const RolloutSpan& span : spans_)
    for (std::size_t k = 1; k <= span.steps; ++k) transitions_ += span.episode->known(span.start + k) ? 1 : 0;
}

void Discrepancy::make_filter(double smoothing_steps) {
  filter_.assign(1, 1.0);
  if (!(smoothing_steps > 0)) return;
  const auto reach = static_cast<std::size_t>(std::ceil(3 * smoothing_steps));
  for (std::size_t k = 1; k <= reach; ++k) {
    const double z = static_cast<double>(k) / smoothing_steps;
    filter_.push_back(std::exp(-0.5 * z * z));
  }
}

// error_ of one state along the span, scaled; rows of lanes.
void Discrepancy::errors_of(const RolloutSpan& span, std::uint32_t state, const double* trajectory) {
  const std::uint32_t nx = config_.model->state_count;
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

void Discrepancy::smooth(std::size_t steps) {
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

void Discrepancy::add_span(const RolloutSpan& span, double* sum) {
  const double* trajectory = rollout_.run(*span.episode->grid, span.start, span.steps, span.episode->at(span.start));
  for (std::uint32_t r = 0; r < config_.model->state_count; ++r) {
    if (scale_[r] == 0) continue;
    errors_of(span, r, trajectory);
    if (filter_.size() > 1) smooth(span.steps);
    for (std::size_t k = 0; k < span.steps; ++k) {
      if (!measured_[k]) continue;
      const double* error = error_.data() + k * kLanes;
      for (std::uint32_t lane = 0; lane < kLanes; ++lane)
        sum[lane] += weight_l1_ * std::fabs(error[lane]) + weight_l2_ * error[lane] * error[lane];
    }
  }
}

std::vector<double> Discrepancy::operator()(const std::vector<double>& v, std::size_t count) {
  const std::uint32_t d = coordinates_.count(), np = config_.param_count;
  std::vector<double> result(count), params(np);
  for (std::size_t first = 0; first < count; first += kLanes) {
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      coordinates_.to_params(v.data() + std::min(first + lane, count - 1) * d, params.data());
      for (std::uint32_t i = 0; i < np; ++i) rollout_.params()[i * kLanes + lane] = params[i];
    }
    double sum[kLanes] = {};
    for (const RolloutSpan& span : spans_) add_span(span, sum);
    for (std::size_t lane = 0; lane < kLanes && first + lane < count; ++lane)
      result[first + lane] = std::isfinite(sum[lane]) ? sum[lane] / static_cast<double>(transitions_)
                                                      : std::numeric_limits<double>::infinity();
  }
  return result;
}

}  // namespace tiller::tools
