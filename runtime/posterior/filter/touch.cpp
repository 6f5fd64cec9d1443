// A filter that looks out for contacts, beside those that learn: a force may come from one period to the next there,
// which a posterior that has long found the world still would first take for noise.

#include <algorithm>
#include <cmath>

#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

/// Whether a state is a force that may be a contact's.
bool FilterPosterior::may_touch(std::uint32_t f) const {
  return disturbances_.wanders(f) && touch_->law[disturbances_.source_of(f) * kChunk] != 0.0;
}

/// Its lanes have the parameters of as many particles, one of each kChunk-th of the weight, and these particles'
/// viscous and dry forces: what is left to the wandering ones is what nobody has learnt.
void FilterPosterior::pick_touch() {
  const Chunk& chunk = *touch_;
  double below = 0.0;
  std::uint32_t i = 0;
  for (std::uint32_t l = 0; l < kChunk; ++l) {
    const double share = (l + 0.5) / kChunk;
    while (i + 1 < n_ && below + cloud_.weight[i] < share) below += cloud_.weight[i++];
    for (std::uint32_t p = 0; p < np_; ++p) chunk.params[p * kChunk + l] = params_now()[p * n_ + i];
    chunk.process_scale[l] = carried_.process_scale[i];
    for (std::uint32_t f = 0; f < lacks_; ++f)
      if (!may_touch(f)) chunk.filter.state[(nx_ + f) * kChunk + l] = carried_.filter.state[(nx_ + f) * n_ + i];
    for (std::uint32_t f = 0; f < disturbances_.drifts(); ++f)  // the parameters have them already
      chunk.filter.state[(nx_ + disturbances_.drift_state(f)) * kChunk + l] = 0.0;
  }
  // these are known, as far as this filter goes
  for (std::uint32_t f = 0; f < lacks_; ++f) {
    if (may_touch(f)) continue;
    for (std::uint32_t c = 0; c < nf_; ++c) {
      const std::uint32_t r = nx_ + f;
      double* row = chunk.filter.covariance + triangle_row(nf_, std::min(r, c), std::max(r, c)) * kChunk;
      std::fill(row, row + kChunk, 0.0);
    }
  }
}

void FilterPosterior::begin_touch() {
  if (!touch_) return;
  for (std::uint32_t l = 0; l < kChunk; ++l) disturbances_.contact_law(touch_->law + l, kChunk);
  pick_touch();
  map_sensors(*touch_, touch_->params, kChunk);
  begin_filters(*touch_, touch_->filter, {touch_->law, kChunk});
}

/// `measured` as it came: what the particles take for a glitch may be a blow. A value that this filter cannot explain
/// either is one.
void FilterPosterior::step_touch(const double* measured) {
  if (!touch_) return;
  const Chunk& chunk = *touch_;
  pick_touch();
  Step step;
  step.period_s = now_.transition.period_s;
  step.input = now_.transition.input;
  step.from = chunk.filter;
  step.params = {chunk.params, kChunk};
  step.process_scale = chunk.process_scale;
  step.law = {chunk.law, kChunk};
  step.history = input_history_;
  map_sensors(chunk, chunk.params, kChunk);
  predict_lanes(chunk, step);
  double seen[TILLER_MAX_MEASUREMENTS];
  std::copy(measured, measured + ny_, seen);
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (!std::isnan(seen[k]) && !lane_explains(chunk, 0, measured, k)) seen[k] = NAN;
  std::fill(chunk.sums, chunk.sums + rows_ * kChunk, 0.0);
  CorrectJob correct = correct_job(seen, chunk);
  correct.squared_error = chunk.sums + ScaleEvidence::kSquared * kChunk;
  correct.log_variance = chunk.sums + ScaleEvidence::kLogs * kChunk;
  filter_->correct(correct);
}

/// Of the noise as it was before a push put anything into it.
void FilterPosterior::contacts(double* mean, double* sd) const {
  if (!touch_) return Posterior::contacts(mean, sd);
  for (std::uint32_t j = 0; j < disturbances_.joints(); ++j) {
    const std::uint32_t state = nx_ + disturbances_.force_state(j), row = triangle_row(nf_, state, state);
    double sum = 0.0, square = 0.0, within = 0.0;
    for (std::uint32_t l = 0; l < kChunk; ++l) {
      const double force = touch_->filter.state[state * kChunk + l];
      sum += force / kChunk;
      square += force * force / kChunk;
      within += touch_->filter.covariance[row * kChunk + l] / kChunk;
    }
    mean[j] = sum;
    sd[j] = std::sqrt(std::fmax(0.0, square - sum * sum) + calm_scale_ * calm_scale_ * std::fmax(0.0, within));
  }
}

}  // namespace tiller
