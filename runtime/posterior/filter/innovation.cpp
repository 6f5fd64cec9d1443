// Input of the adequacy test: each value against the mixture's prediction, and what disturbances would have put
// into it.

#include <cmath>

#include "posterior/attitude_measurement.hpp"
#include "posterior/filter/filter_posterior.hpp"
#include "rollout/attitude.hpp"

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
  double speed[TILLER_MAX_MEASUREMENTS], place[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < ny_; ++k) {
    const std::uint32_t state = config_->measured_state[k], row = triangle_row(nf_, state, state);
    double mean = 0.0, square = 0.0, within = 0.0, moved = 0.0;
    for (std::uint32_t i = 0; i < n_; ++i) {
      const Chunk& chunk = chunks_[i / kChunk];
      const std::uint32_t lane = i % kChunk;
      const double w = cloud_.weight[i], predicted = chunk.predicted.state[state * kChunk + lane];
      if (!(w > 0.0) || !std::isfinite(predicted)) continue;
      const MeasurementMap map = sensor(chunk, k, lane);
      const double variance =
          map.gain * map.gain * chunk.predicted.covariance[row * kChunk + lane] + measurement_variance_[k];
      const double* state_of = chunk.predicted.state + lane;
      const double error = innovation_of(*config_, now_.transition.measured, k, state_of, kChunk, map);
      mean += w * error;
      square += w * error * error;
      within += w * variance;
      moved += w * (predicted - carried_.filter.state[state * n_ + i]);  // of a quaternion a feature as good as any
    }
    const double between = std::fmax(0.0, square - mean * mean);
    now.normalised[k] = mean / std::sqrt(noise_scale_ * noise_scale_ * within + between);
    const std::uint32_t velocity = velocity_state(*config_->model, state);
    speed[k] = velocity < nx_ ? mean_before(velocity) : moved / now_.transition.period_s;
    const std::uint32_t position = position_state(*config_->model, state);
    place[k] = position < nx_ ? mean_before(position) : 0.0;
  }
  respond(speed, disturbances_.joints() > 0 ? place : nullptr, now);
  const bool early = early_ > 0;
  if (early) --early_;
  if (early && exponent_ < 1.0) adequacy_->begin();
  adequacy_->take(now);
}

/// The heaviest particle's filter stands for all: a feature need only be known beforehand, and they hardly differ. Its
/// Jacobian is the prediction's; that by the inputs is made here.
void FilterPosterior::respond(const double* speed, const double* place, Innovation& now) {
  const std::uint32_t i = heaviest(), lane = i % kChunk;
  const Chunk& chunk = chunks_[i / kChunk];
  const Step step = particle_step(i / kChunk);
  LineariseJob job = linearise_job(chunk, step);
  if (chunk.drifted) job.params = {chunk.drifted, kChunk};
  job.next_state = response_scratch_;
  job.next_effect_state = nullptr;
  job.a = response_scratch_ + std::size_t{nx_} * kChunk;
  job.b = job.a + std::size_t{nx_} * nx_ * kChunk;
  table_->linearise(*config_->model, job);
  to_tangent_rows(quaternions_, job.next_state + lane, kChunk, nu_, job.b + lane, kChunk);
  double covariance[triangle_rows(kMaxFilterStates)];
  for (std::uint32_t r = 0; r < triangle_; ++r) covariance[r] = chunk.predicted.covariance[r * kChunk + lane];

  unsigned char used[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < ny_; ++k) used[k] = std::isnan(now_.transition.measured[k]) ? 0 : 1;
  const ErrorDynamics error = {chunk.jacobian + lane, job.b + lane, kChunk, covariance};
  response_->predict(error, now_.transition.period_s, speed, place, now_.transition.input, now);
  response_->correct(error, used, measurement_variance_);
}

}  // namespace tiller
