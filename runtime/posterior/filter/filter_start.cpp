// Where the filters begin: at the configured state, or, in mid-run, wherever the robot may have got to.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/attitude_measurement.hpp"
#include "posterior/filter/filter_posterior.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

void FilterPosterior::clear_start() {
  std::fill(start_.state, start_.state + nf_, 0.0);
  std::fill(start_.covariance, start_.covariance + triangle_, 0.0);
  std::fill(start_.effect_state, start_.effect_state + ns_, 0.0);
}

/// The configured state with deviations sd (nx), and a first measurement (ny).
void FilterPosterior::set_start(const double* sd, const double* measured) {
  clear_start();
  for (std::uint32_t r = 0; r < nx_; ++r) {
    start_.state[r] = config_->initial_state[r];
    start_.covariance[triangle_row(nf_, r, r)] = (quaternions_ >> r) & 1u ? 0.0 : sd[r] * sd[r];
  }
  for_quaternions(quaternions_, [&](std::uint32_t first) {
    write_quaternion(normalised(read_quaternion(start_.state + first)), start_.state + first);
  });
  for (std::uint32_t k = 0; k < ny_; ++k) start_.measured[k] = measured ? measured[k] : NAN;
  take_attitudes(*config_, start_.measured);
  knows_lacks_ = false;
  if (lacks_ > 0 && measured) measure_forces();
}

/// How large a force has to be to matter, from what forces do to the first chunk's particles at the configured state.
void FilterPosterior::measure_forces() {
  const Chunk& chunk = chunks_[0];
  map_sensors(chunk, cloud_.params, n_);
  begin_filters(chunk, chunk.filter, {carried_.law, n_});
  Step step;
  step.period_s = config_->period_s;
  step.input = config_->safety.safe_command;
  step.from = chunk.filter;
  step.params = {cloud_.params, n_};
  step.history = input_history_;
  step.law = {carried_.law, n_};
  predict_lanes(chunk, step);
  disturbances_.measure_reach(disturbance_job(chunk, step));
}

/// The start's law, corrected by its measurement, which does not count into the likelihood (of no parameter but a
/// sensor's, and of these the others tell more). The chunk says how the sensors read.
void FilterPosterior::begin_filters(const Chunk& chunk, const FilterRows& rows, Lanes<double> law) const {
  double unused[2 * kChunk] = {};
  const auto fill = [&rows](double* to, std::uint32_t count, const double* value) {
    for (std::uint32_t i = 0; i < count; ++i)
      for (std::uint32_t l = 0; l < kChunk; ++l) to[i * rows.stride + l] = value[i];
  };
  fill(rows.state, nf_, start_.state);
  fill(rows.covariance, triangle_, start_.covariance);
  fill(rows.effect_state, ns_, start_.effect_state);
  for (std::uint32_t l = 0; l < kChunk && lacks_ > 0 && !knows_lacks_; ++l) {
    double variance[kMaxFilterStates];
    disturbances_.prior_variance(law.data + l, static_cast<std::uint32_t>(law.stride), began_s_, variance);
    for (std::uint32_t f = 0; f < lacks_; ++f)
      rows.covariance[triangle_row(nf_, nx_ + f, nx_ + f) * rows.stride + l] = variance[f];
  }
  CorrectJob job = correct_job(start_.measured, chunk);
  job.from = job.to = rows;
  job.squared_error = unused;
  job.log_variance = unused + kChunk;
  filter_->correct(job);
}

void FilterPosterior::begin_all_filters() {
  for (std::uint32_t c = 0; c < n_ / kChunk; ++c) {
    const std::uint32_t at = c * kChunk;
    map_sensors(chunks_[c], cloud_.params + at, n_);
    begin_filters(chunks_[c], carried_lanes(at), lacks_ > 0 ? Lanes<double>{carried_.law + at, n_} : Lanes<double>{});
  }
  note_drift();
}

tiller_status_t FilterPosterior::start(const double* measured) {
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (std::isinf(measured[k])) return tiller_status_sensor_not_finite;
  if (started_) close_window();
  // after a pause a state may be as far from where it began as it has ever been: believing it closer, the first values
  // would speak of noise where they only speak of the pause
  double sd[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < nx_; ++i) sd[i] = std::hypot(config_->initial_state_sd[i], reach_[i]);
  for (std::uint32_t i = 0; i < kHistory; ++i)
    for (std::uint32_t j = 0; j < nu_; ++j) input_history_[i * nu_ + j] = config_->safety.safe_command[j];
  set_start(sd, measured);
  begin_all_filters();
  begin_touch();
  banks_begun_ = false;  // no lane knows how far the robot got meanwhile
  for (std::uint32_t& run : gate_run_) run = 0;
  rest_.begin();
  if (adequacy_) {
    adequacy_->begin();
    response_->begin();
  }
  started_ = true;
  return tiller_status_ok;
}

/// The heaviest particle stands for all.
void FilterPosterior::note_reach() {
  const std::uint32_t particle = heaviest();
  double at[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < nx_; ++i) at[i] = carried_.filter.state[i * n_ + particle];
  state_differences(*config_->model, at, config_->initial_state, at);
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double off = std::fabs(at[i]);
    if (off > reach_[i] && std::isfinite(off)) reach_[i] = off;
  }
}

}  // namespace tiller
