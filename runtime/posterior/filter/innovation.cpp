// What the adequacy test is fed with: each value against the mixture's prediction, and what disturbances would have put
// into it.

#include <cmath>

#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

void FilterPosterior::clear_adequacy() {
  if (!adequacy_) return;
  adequacy_->reset();
  response_->begin();
}

/// Mean of a state before the transition.
double FilterPosterior::mean_before(std::uint32_t state) const {
  const double* row = carried_.filter.state + state * n_;
  double mean = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) mean += cloud_.weight[i] * row[i];
  return mean;
}

/// After predict() and gate(), before correct(). Predictive variance: what each filter expects, times the noise's
/// estimated scale, and what the particles disagree about. Cost: O(N ny).
void FilterPosterior::test_innovation() {
  Innovation now;
  double speed[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < ny_; ++k) {
    const std::uint32_t state = config_->measured_state[k], row = triangle_row(nx_, state, state);
    double mean = 0.0, square = 0.0, within = 0.0, moved = 0.0;
    for (std::uint32_t i = 0; i < n_; ++i) {
      const Chunk& chunk = chunks_[i / kChunk];
      const std::uint32_t lane = i % kChunk;
      const double w = cloud_.weight[i], predicted = chunk.predicted.state[state * kChunk + lane];
      if (!(w > 0.0) || !std::isfinite(predicted)) continue;
      const MeasurementMap map = sensor(chunk, k, lane);
      const double error = state_difference(*config_->model, state, now_.measured[k], map.of(predicted));
      mean += w * error;
      square += w * error * error;
      within += w * (map.gain * map.gain * chunk.predicted.covariance[row * kChunk + lane] + measurement_variance_[k]);
      moved += w * (predicted - carried_.filter.state[state * n_ + i]);
    }
    const double between = std::fmax(0.0, square - mean * mean);
    now.normalised[k] = mean / std::sqrt(noise_scale_ * noise_scale_ * within + between);
    const std::uint32_t velocity = velocity_state(*config_->model, state);
    speed[k] = velocity < nx_ ? mean_before(velocity) : moved / now_.period_s;
  }
  respond(speed, now);
  adequacy_->take(now);
}

/// The heaviest particle's filter stands for all: a feature need only be known beforehand, and they hardly differ.
void FilterPosterior::respond(const double* speed, Innovation& now) {
  std::uint32_t heaviest = 0;
  for (std::uint32_t i = 1; i < n_; ++i)
    if (cloud_.weight[i] > cloud_.weight[heaviest]) heaviest = i;
  const std::uint32_t lane = heaviest % kChunk, at = heaviest - lane;
  const Chunk& chunk = chunks_[heaviest / kChunk];
  LineariseJob job = predict_job(chunk, at);
  job.next_effect_state = nullptr;
  job.b = input_jacobian_;
  table_->linearise(*config_->model, job);

  unsigned char used[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < ny_; ++k) used[k] = std::isnan(now_.measured[k]) ? 0 : 1;
  const ErrorDynamics error = {chunk.jacobian + lane, input_jacobian_ + lane, chunk.predicted.covariance + lane,
                               kChunk};
  response_->predict(error, now_.period_s, speed, now_.input, now);
  response_->correct(error, used, measurement_variance_);
}

}  // namespace tiller
