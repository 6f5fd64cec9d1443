#include "tools/identify/wasserstein_discrepancy.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/rng.hpp"
#include "tools/identify/wasserstein.hpp"

namespace tiller::tools {
namespace {

double wrapped(double difference, bool angle) {
  return angle ? std::remainder(difference, 6.283185307179586) : difference;
}

}  // namespace

WassersteinDiscrepancy::WassersteinDiscrepancy(const MethodProblem& problem, const Coordinates& coordinates,
                                               const std::vector<Episode>& episodes, const DiscrepancyForm& form)
    : Discrepancy(problem, coordinates, episodes, form), direction_(slice_directions(kDirections, dimension())) {
  take_logs(form.scale);
  project_logs();
  for (const RolloutSpan& span : spans_)
    for (std::size_t k = 1; k <= span.steps; ++k)
      if (span.episode->known(span.start + k)) add_noise(span, k);
}

void WassersteinDiscrepancy::add_noise(const RolloutSpan& span, std::size_t k) {
  Rng rng(0, kRngNoise, noise_.size());
  const double *start = span.episode->sd_at(span.start), *end = span.episode->sd_at(span.start + k);
  for (std::uint32_t r = 0; r < state_count(); ++r) {
    const double process = config_.process_sd[r], time_s = static_cast<double>(k) * config_.period_s;
    const double sd = std::sqrt(process * process * time_s + start[r] * start[r] + end[r] * end[r]);
    noise_.push_back(scale_[r] * sd * rng.normal());
  }
}

// point_ and scale_: displacements over their RMS, starts and inputs over their standard deviations.
void WassersteinDiscrepancy::take_logs(bool scale) {
  const std::uint32_t nx = state_count(), nu = config_.model->input_count;
  for (const RolloutSpan& span : spans_)
    for (std::size_t k = 1; k <= span.steps; ++k) {
      const Episode& episode = *span.episode;
      if (!episode.known(span.start + k)) continue;
      const double *start = episode.at(span.start), *now = episode.at(span.start + k);
      for (std::uint32_t r = 0; r < nx; ++r)
        point_.push_back(wrapped(now[r] - start[r], (config_.model->angle_mask >> r) & 1u));
      point_.insert(point_.end(), start, start + nx);
      for (std::uint32_t i = 0; i < nu; ++i) point_.push_back(episode.grid->input[i][span.start + k - 1]);
    }
  scale_.assign(dimension(), 1.0);
  const std::size_t n = point_.size() / dimension();
  for (std::size_t j = 0; scale && j < dimension(); ++j) {
    double mean = 0, square = 0;
    for (std::size_t s = 0; j >= nx && s < n; ++s) mean += point_[s * dimension() + j] / static_cast<double>(n);
    for (std::size_t s = 0; s < n; ++s) square += std::pow(point_[s * dimension() + j] - mean, 2);
    scale_[j] = square > 0 ? std::sqrt(static_cast<double>(n) / square) : 0.0;
  }
  for (std::size_t s = 0; s < point_.size(); ++s) point_[s] *= scale_[s % dimension()];
}

void WassersteinDiscrepancy::project_logs() {
  const std::size_t nx = state_count(), n = point_.size() / dimension();
  context_.assign(kDirections * n, 0.0);
  scratch_.resize(n);
  for (std::size_t l = 0; l < kDirections; ++l) {
    const double* direction = direction_.data() + l * dimension();
    for (std::size_t s = 0; s < n; ++s) {
      const double* point = point_.data() + s * dimension();
      double& context = context_[l * n + s];
      for (std::size_t j = nx; j < dimension(); ++j) context += direction[j] * point[j];
      scratch_[s] = context;
      for (std::size_t j = 0; j < nx; ++j) scratch_[s] += direction[j] * point[j];
    }
    std::sort(scratch_.begin(), scratch_.end());
    logged_.insert(logged_.end(), scratch_.begin(), scratch_.end());
  }
}

void WassersteinDiscrepancy::add(const RolloutSpan& span, const double* trajectory) {
  const std::uint32_t nx = state_count();
  const double* start = span.episode->at(span.start);
  for (std::size_t k = 1; k <= span.steps; ++k) {
    if (!span.episode->known(span.start + k)) continue;
    for (std::uint32_t r = 0; r < nx; ++r) {
      const bool angle = (config_.model->angle_mask >> r) & 1u;
      const double* row = trajectory + (k * nx + r) * kLanes;
      const double noise = noise_[simulated_.size() / kLanes];
      for (std::uint32_t lane = 0; lane < kLanes; ++lane)
        simulated_.push_back(scale_[r] * wrapped(row[lane] - start[r], angle) + noise);
    }
  }
}

double WassersteinDiscrepancy::value(std::uint32_t lane) {
  const std::size_t nx = state_count(), n = scratch_.size();
  double sum = 0;
  for (std::size_t l = 0; l < kDirections; ++l) {
    const double* direction = direction_.data() + l * dimension();
    for (std::size_t s = 0; s < n; ++s) {
      scratch_[s] = context_[l * n + s];
      for (std::size_t r = 0; r < nx; ++r) scratch_[s] += direction[r] * simulated_[(s * nx + r) * kLanes + lane];
      // what is not finite has no place in a sorted order
      if (!std::isfinite(scratch_[s])) return std::numeric_limits<double>::infinity();
    }
    std::sort(scratch_.begin(), scratch_.end());
    sum += sorted_wasserstein_1d(scratch_.data(), logged_.data() + l * n, n);
  }
  return sum / kDirections;
}

}  // namespace tiller::tools
