#include "tools/identify/discrepancy.hpp"

#include <cmath>
#include <limits>

#include "tools/identify/candidates.hpp"
#include "tools/identify/residual_discrepancy.hpp"
#include "tools/identify/wasserstein_discrepancy.hpp"

namespace tiller::tools {

std::unique_ptr<Discrepancy> Discrepancy::make(const MethodProblem& problem, const Coordinates& coordinates,
                                               const std::vector<Episode>& episodes, const DiscrepancyForm& form) {
  if (form.kind == DiscrepancyKind::wasserstein)
    return std::make_unique<WassersteinDiscrepancy>(problem, coordinates, episodes, form);
  return std::make_unique<ResidualDiscrepancy>(problem, coordinates, episodes, form);
}

Discrepancy::Discrepancy(const MethodProblem& problem, const Coordinates& coordinates,
                         const std::vector<Episode>& episodes, const DiscrepancyForm& form)
    : config_(*problem.config),
      spans_(make_spans(episodes, form.steps)),
      coordinates_(coordinates),
      rollout_(*problem.config, kLanes) {
  for (const RolloutSpan& span : spans_)
    for (std::size_t k = 1; k <= span.steps; ++k) transitions_ += span.episode->known(span.start + k) ? 1 : 0;
}

double Discrepancy::displacement_scale(std::uint32_t state) const {
  double square = 0, count = 0;
  for (const RolloutSpan& span : spans_)
    for (std::size_t k = 1; k <= span.steps; ++k) {
      const Episode& episode = *span.episode;
      const double d =
          state_difference(*config_.model, state, episode.at(span.start + k)[state], episode.at(span.start)[state]);
      if (!std::isfinite(d)) continue;
      square += d * d;
      count += 1;
    }
  return square > 0 ? std::sqrt(count / square) : 0.0;
}

std::vector<double> Discrepancy::operator()(const std::vector<double>& v, std::size_t count) {
  std::vector<double> result(count);
  for (std::size_t first = 0; first < count; first += kLanes) {
    load_lanes(coordinates_, v, first, rollout_);
    begin();
    for (const RolloutSpan& span : spans_)
      add(span, rollout_.run(*span.episode->grid, span.start, span.steps, span.episode->at(span.start)));
    for (std::uint32_t lane = 0; lane < kLanes && first + lane < count; ++lane) {
      const double found = value(lane);
      result[first + lane] = std::isfinite(found) ? found : std::numeric_limits<double>::infinity();
    }
  }
  return result;
}

}  // namespace tiller::tools
