#include "tools/identify/likelihood.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/identify/candidates.hpp"

namespace tiller::tools {

TransitionLikelihood::TransitionLikelihood(const MethodProblem& problem, const Coordinates& coordinates,
                                           const std::vector<Episode>& episodes)
    : config_(*problem.config),
      coordinates_(coordinates),
      rollout_(*problem.config, kLanes),
      spans_(make_spans(episodes, 1)) {
  set_noise();
}

void TransitionLikelihood::set_noise() {
  const std::uint32_t nx = config_.model->state_count;
  const std::vector<double> least = least_variance(*config_.model, spans_);
  precision_.assign(spans_.size() * nx, 0.0);
  for (std::size_t s = 0; s < spans_.size(); ++s) {
    const Episode& episode = *spans_[s].episode;
    const std::size_t start = spans_[s].start;
    for (std::uint32_t r = 0; r < nx; ++r) {
      if (!std::isfinite(episode.at(start + 1)[r])) continue;
      const double process = config_.process_sd[r], before = episode.sd_at(start)[r],
                   after = episode.sd_at(start + 1)[r];
      const double variance =
          std::max(process * process * config_.period_s + before * before + after * after, least[r]);
      precision_[s * nx + r] = 1 / variance;
      constant_ -= 0.5 * std::log(6.283185307179586 * variance);
    }
    transitions_ += episode.known(start + 1) ? 1 : 0;
  }
}

void TransitionLikelihood::add_span(std::size_t index, double* sum) {
  const RolloutSpan& span = spans_[index];
  const std::uint32_t nx = config_.model->state_count;
  const double* next = rollout_.run(*span.episode->grid, span.start, 1, span.episode->at(span.start)) + nx * kLanes;
  for (std::uint32_t r = 0; r < nx; ++r) {
    const double precision = precision_[index * nx + r], known = span.episode->at(span.start + 1)[r];
    if (precision == 0) continue;
    const bool angle = (config_.model->angle_mask >> r) & 1u;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      double e = next[r * kLanes + lane] - known;
      if (angle && std::fabs(e) > 3.141592653589793) e = std::remainder(e, 6.283185307179586);
      sum[lane] -= 0.5 * precision * e * e;
    }
  }
}

std::vector<double> TransitionLikelihood::operator()(const std::vector<double>& v, std::size_t count) {
  std::vector<double> result(count);
  for (std::size_t first = 0; first < count; first += kLanes) {
    load_lanes(coordinates_, v, first, rollout_);
    double sum[kLanes] = {};
    for (std::size_t s = 0; s < spans_.size(); ++s) add_span(s, sum);
    for (std::size_t lane = 0; lane < kLanes && first + lane < count; ++lane)
      result[first + lane] =
          std::isfinite(sum[lane]) ? sum[lane] + constant_ : -std::numeric_limits<double>::infinity();
  }
  return result;
}

}  // namespace tiller::tools
