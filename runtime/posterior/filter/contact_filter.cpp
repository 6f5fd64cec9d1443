#include "posterior/filter/contact_filter.hpp"

#include <algorithm>
#include <cmath>

#include "posterior/filter/mixture_moments.hpp"
#include "posterior/filter/outlier_gate.hpp"

namespace tiller {

ContactFilter* ContactFilter::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                      const DisturbanceStates& disturbances, const DisturbanceStates* at,
                                      std::uint32_t d) {
  bool feels = false;
  for (std::uint32_t j = 0; j < disturbances.joints(); ++j)
    feels = feels || std::isfinite(config.safety.contact_force[config.model->joints[j].velocity]);
  if (!feels) return nullptr;
  auto* const c = arena.take<ContactFilter>(1);
  const FilterChunk* const chunk = FilterChunk::lay_out(arena, 1, config, setup, disturbances, at, d);
  if (c) c->chunk_ = chunk;
  return c;
}

/// Whether a state is a force that may be a contact's.
bool ContactFilter::may_touch(std::uint32_t f) const {
  const DisturbanceStates& disturbances = *chunk_->lacking;
  return disturbances.wanders(f) && chunk_->law[disturbances.source_of(f) * kLanes] != 0.0;
}

void ContactFilter::follow(const FilterParticles& particles) const {
  const FilterChunk& chunk = *chunk_;
  const DisturbanceStates& disturbances = *chunk.lacking;
  const std::uint32_t n = particles.n(), nf = chunk.nf, nx = nf - disturbances.states();
  double below = 0.0;
  std::uint32_t i = 0;
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    const double share = (l + 0.5) / kLanes;
    while (i + 1 < n && below + particles.weight(i) < share) below += particles.weight(i++);
    for (std::uint32_t p = 0; p < particles.cloud.np; ++p)
      chunk.params[p * kLanes + l] = particles.params_now()[p * n + i];
    chunk.process_scale[l] = particles.process_scale[i];
    for (std::uint32_t f = 0; f < disturbances.states(); ++f)
      if (!may_touch(f)) chunk.filter.state[(nx + f) * kLanes + l] = particles.state(nx + f)[i];
    for (std::uint32_t f = 0; f < disturbances.drifts(); ++f)  // the parameters have them already
      chunk.filter.state[(nx + disturbances.drift_state(f)) * kLanes + l] = 0.0;
  }
  // these are known, as far as this filter goes
  for (std::uint32_t f = 0; f < disturbances.states(); ++f) {
    if (may_touch(f)) continue;
    for (std::uint32_t c = 0; c < nf; ++c) {
      const std::uint32_t r = nx + f;
      double* row = chunk.filter.covariance + triangle_row(nf, std::min(r, c), std::max(r, c)) * kLanes;
      std::fill(row, row + kLanes, 0.0);
    }
  }
}

void ContactFilter::begin(const LaneFilter& filter, const FilterStart& start, const FilterParticles& particles) {
  for (std::uint32_t l = 0; l < kLanes; ++l) chunk_->lacking->contact_law(chunk_->law + l, kLanes);
  follow(particles);
  start.begin_filters(filter, *chunk_, chunk_->filter, {chunk_->params, kLanes}, {chunk_->law, kLanes});
}

void ContactFilter::step(const LaneFilter& filter, const FilterParticles& particles, const Observation& seen,
                         double noise_scale) {
  follow(particles);
  filter.predict_own(*chunk_, seen, chunk_->filter);
  double measured[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < filter.ny(); ++k) {
    const double y = seen.measured[k];
    measured[k] = !std::isnan(y) && !OutlierGate::explains(filter, *chunk_, 0, seen.measured, k, noise_scale) ? NAN : y;
  }
  Observation left = seen;
  left.measured = measured;
  chunk_->clear_sums();
  filter.correct_own(*chunk_, left, chunk_->filter);
}

void ContactFilter::read(const LaneFilter& filter, double noise_scale, double* mean, double* sd) const {
  const DisturbanceStates& disturbances = *chunk_->lacking;
  for (std::uint32_t j = 0; j < disturbances.joints(); ++j) {
    const std::uint32_t state = filter.nx() + disturbances.force_state(j);
    const std::uint32_t row = triangle_row(chunk_->nf, state, state);
    MixtureMoments all;
    for (std::uint32_t l = 0; l < kLanes; ++l)
      all.add(1.0 / kLanes, chunk_->filter.state[state * kLanes + l], chunk_->filter.covariance[row * kLanes + l]);
    mean[j] = all.mean;
    sd[j] = all.deviation(noise_scale);
  }
}

}  // namespace tiller
