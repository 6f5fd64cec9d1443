// Report of the posterior: moments, quantiles, particles.

#include <cmath>

#include "posterior/filter/filter_posterior.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

/// Moments of quaternions, from the differences from one particle, in the last three of four states.
void FilterPosterior::turn_moments(std::uint32_t about, double* state_mean, double* state_sd) const {
  for_quaternions(quaternions_, [&](std::uint32_t first) {
    const double* q = carried_.filter.state + first * n_;
    const Quaternion<double> middle = read_quaternion(q + about, n_);
    double mean[3] = {}, between[3] = {}, within[3] = {};
    for (std::uint32_t k = 0; k < n_; ++k) {
      const Vector3<double> d = attitude_difference(read_quaternion(q + k, n_), middle);
      const double off[3] = {d.x, d.y, d.z};
      for (std::uint32_t i = 0; i < 3; ++i) {
        const std::uint32_t row = triangle_row(nf_, first + 1 + i, first + 1 + i);
        mean[i] += cloud_.weight[k] * off[i];
        between[i] += cloud_.weight[k] * off[i] * off[i];
        within[i] += cloud_.weight[k] * carried_.filter.covariance[row * n_ + k];
      }
    }
    if (state_mean) write_quaternion(normalised(attitude_sum(middle, {mean[0], mean[1], mean[2]})), state_mean + first);
    if (!state_sd) return;
    state_sd[first] = 0.0;
    for (std::uint32_t i = 0; i < 3; ++i)
      state_sd[first + 1 + i] = std::sqrt(std::fmax(0.0, between[i] - mean[i] * mean[i]) +
                                          noise_scale_ * noise_scale_ * std::fmax(0.0, within[i]));
  });
}

void FilterPosterior::covariance(double* covariance) const {
  cloud_.covariance(params_now(), covariance);
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) {
    const double sd = drift_sd(i);
    covariance[std::size_t{disturbances_.drift_param(i)} * (np_ + 1)] += sd * sd;
  }
}

double FilterPosterior::quantile(std::uint32_t param, double q) const {
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i)
    if (disturbances_.drift_param(i) == param) return drifting_quantile(i, q);
  return cloud_.quantile(param, q);
}

void FilterPosterior::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  cloud_.moments(params_now(), param_mean, param_sd);
  for (std::uint32_t i = 0; i < disturbances_.drifts() && param_sd; ++i) {
    const std::uint32_t param = disturbances_.drift_param(i);
    param_sd[param] = std::hypot(param_sd[param], drift_sd(i));
  }
  if (!state_mean && !state_sd) return;
  const std::uint32_t about = heaviest();
  for (std::uint32_t i = 0; i < nx_; ++i) {
    // about one particle, so that angles on both sides of the cut average rightly
    const double* row = carried_.filter.state + i * n_;
    const double* variance = carried_.filter.covariance + triangle_row(nf_, i, i) * n_;
    double mean = 0.0, within = 0.0, between = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k) {
      const double difference = state_difference(*config_->model, i, row[k], row[about]);
      mean += cloud_.weight[k] * difference;
      between += cloud_.weight[k] * difference * difference;
      within += cloud_.weight[k] * variance[k];
    }
    if (state_mean) state_mean[i] = row[about] + mean;
    if (!state_sd) continue;
    // far outside of any machine's range rounding can leave a variance below zero
    const double variance_within = within < 0.0 ? 0.0 : noise_scale_ * noise_scale_ * within;
    state_sd[i] = std::sqrt(std::fmax(0.0, between - mean * mean) + variance_within);
  }
  turn_moments(about, state_mean, state_sd);
}

void FilterPosterior::state_covariance(std::uint32_t nx, double* covariance) const {
  for (std::uint32_t r = 0; r < nx; ++r)
    for (std::uint32_t c = r; c < nx; ++c) {
      const double* row = carried_.filter.covariance + triangle_row(nf_, r, c) * n_;
      double sum = 0.0;
      for (std::uint32_t k = 0; k < n_; ++k) sum += cloud_.weight[k] * row[k];
      covariance[r * nx + c] = covariance[c * nx + r] = noise_scale_ * noise_scale_ * sum;
    }
}

void FilterPosterior::particle(std::uint32_t index, double* params, double* state, double* weight) const {
  if (index >= n_) return;
  for (std::uint32_t i = 0; i < np_ && params; ++i) params[i] = params_now()[i * n_ + index];
  for (std::uint32_t i = 0; i < nx_ && state; ++i) state[i] = carried_.filter.state[i * n_ + index];
  if (weight) *weight = cloud_.weight[index];
}

void FilterPosterior::particle_effects(std::uint32_t index, double* effect_state) const {
  if (index >= n_) return;
  for (std::uint32_t i = 0; i < ns_; ++i) effect_state[i] = carried_.filter.effect_state[i * n_ + index];
}

/// One hypothesis: the mean, which stands for the cloud better than any single particle.
void FilterPosterior::take_mean(float* params, float* state, float* effect_state) const {
  double mean[TILLER_MAX_PARAMS], state_mean[TILLER_MAX_STATES];
  moments(params ? mean : nullptr, nullptr, state ? state_mean : nullptr, nullptr);
  for (std::uint32_t i = 0; i < np_ && params; ++i) params[i] = static_cast<float>(mean[i]);
  for (std::uint32_t i = 0; i < nx_ && state; ++i) state[i] = static_cast<float>(state_mean[i] - origin()[i]);
  for (std::uint32_t i = 0; i < ns_ && effect_state; ++i) {
    double sum = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k) sum += cloud_.weight[k] * carried_.filter.effect_state[i * n_ + k];
    effect_state[i] = static_cast<float>(sum);
  }
}

void FilterPosterior::draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
                           float* history) const {
  if (count == 1)
    take_mean(params, state, effect_state);
  else
    take_strata(count, tick, params, state, effect_state);
  for (std::uint32_t i = 0; i < setup_.delay_steps * nu_ && history; ++i)
    history[i] = static_cast<float>(input_history_[i]);
}

void FilterPosterior::take_strata(std::uint32_t count, std::uint64_t tick, float* params, float* state,
                                  float* effect_state) const {
  const Cloud::Drawn what[] = {{params_now(), np_, params},
                               {carried_.filter.state, nx_, state, origin()},
                               {carried_.filter.effect_state, ns_, effect_state}};
  cloud_.draw(count, tick, what, 3);
}

/// The process noise's deviation with its own factor; the sensors' have the common scale alone.
void FilterPosterior::report(PosteriorReport& report) const {
  report = {};
  double factor = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) factor += cloud_.weight[i] * carried_.process_scale[i];
  for (std::uint32_t r = 0; r < nx_; ++r)
    report.noise_sd[r] = noise_scale_ * std::sqrt(factor) * config_->process_sd[r];
  report_jumps(report);
  report.delay_weight[0] = report.forgetting_weight[0] = 1.0;
  report.relearned = relearned_;
  report.lost = lost_;
}

}  // namespace tiller
