#include "posterior/filter/filter_estimate.hpp"

#include <cmath>

#include "posterior/filter/mixture_moments.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

/// Moments of quaternions, from the differences from one particle, in the last three of four states.
void FilterEstimate::turn_moments(std::uint32_t about, double* state_mean, double* state_sd) const {
  const std::uint32_t n = p_.n();
  for_quaternions(p_.cloud.config->model->quaternion_mask, [&](std::uint32_t first) {
    const double* q = p_.state(first);
    const Quaternion<double> middle = read_quaternion(q + about, n);
    MixtureMoments part[3];
    for (std::uint32_t k = 0; k < n; ++k) {
      const Vector3<double> d = attitude_difference(read_quaternion(q + k, n), middle);
      const double off[3] = {d.x, d.y, d.z};
      for (std::uint32_t i = 0; i < 3; ++i)
        part[i].add(p_.weight(k), off[i], p_.covariance(first + 1 + i, first + 1 + i)[k]);
    }
    if (state_mean)
      write_quaternion(normalised(attitude_sum(middle, {part[0].mean, part[1].mean, part[2].mean})),
                       state_mean + first);
    if (!state_sd) return;
    state_sd[first] = 0.0;
    for (std::uint32_t i = 0; i < 3; ++i) state_sd[first + 1 + i] = part[i].deviation(noise_scale_);
  });
}

void FilterEstimate::covariance(double* covariance) const {
  const DisturbanceStates& disturbances = *p_.disturbances;
  p_.cloud.covariance(p_.params_now(), covariance);
  for (std::uint32_t i = 0; i < disturbances.drifts(); ++i) {
    const double sd = drift_sd(i);
    covariance[std::size_t{disturbances.drift_param(i)} * (p_.cloud.np + 1)] += sd * sd;
  }
}

double FilterEstimate::quantile(std::uint32_t param, double q) const {
  const std::uint32_t drift = p_.disturbances->drift_of(param);
  return drift < p_.disturbances->drifts() ? drifting_quantile(drift, q) : p_.cloud.quantile(param, q);
}

void FilterEstimate::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  const DisturbanceStates& disturbances = *p_.disturbances;
  p_.cloud.moments(p_.params_now(), param_mean, param_sd);
  for (std::uint32_t i = 0; i < disturbances.drifts() && param_sd; ++i) {
    const std::uint32_t param = disturbances.drift_param(i);
    param_sd[param] = std::hypot(param_sd[param], drift_sd(i));
  }
  if (!state_mean && !state_sd) return;
  const std::uint32_t about = p_.heaviest(), n = p_.n();
  const tiller_model_t& model = *p_.cloud.config->model;
  const double* weight = p_.cloud.weight;
  for (std::uint32_t i = 0; i < nx(); ++i) {
    // about one particle, so that angles on both sides of the cut average rightly
    const double *row = p_.state(i), *variance = p_.covariance(i, i);
    MixtureMoments all;
    for (std::uint32_t k = 0; k < n; ++k)
      all.add(weight[k], state_difference(model, i, row[k], row[about]), variance[k]);
    if (state_mean) state_mean[i] = row[about] + all.mean;
    if (state_sd) state_sd[i] = all.deviation(noise_scale_);
  }
  turn_moments(about, state_mean, state_sd);
}

void FilterEstimate::state_covariance(std::uint32_t nx, double* covariance) const {
  for (std::uint32_t r = 0; r < nx; ++r)
    for (std::uint32_t c = r; c < nx; ++c)
      covariance[r * nx + c] = covariance[c * nx + r] = noise_scale_ * noise_scale_ * p_.mean(p_.covariance(r, c));
}

/// One hypothesis: the mean, which stands for the cloud better than any single particle.
void FilterEstimate::draw_mean(const double* origin, float* params, float* state, float* effect_state) const {
  double mean[TILLER_MAX_PARAMS], state_mean[TILLER_MAX_STATES];
  moments(params ? mean : nullptr, nullptr, state ? state_mean : nullptr, nullptr);
  for (std::uint32_t i = 0; i < p_.cloud.np && params; ++i) params[i] = static_cast<float>(mean[i]);
  for (std::uint32_t i = 0; i < nx() && state; ++i) state[i] = static_cast<float>(state_mean[i] - origin[i]);
  for (std::uint32_t i = 0; i < p_.ns && effect_state; ++i)
    effect_state[i] = static_cast<float>(p_.mean(p_.effect_state(i)));
}

void FilterEstimate::draw(std::uint32_t count, std::uint64_t tick, const double* origin, float* params, float* state,
                          float* effect_state) const {
  if (count == 1) return draw_mean(origin, params, state, effect_state);
  const Cloud::Drawn what[] = {{p_.params_now(), p_.cloud.np, params},
                               {p_.filter.state, nx(), state, origin},
                               {p_.filter.effect_state, p_.ns, effect_state}};
  p_.cloud.draw(count, tick, what, 3);
}

void FilterEstimate::report_noise(PosteriorReport& report) const {
  const double factor = p_.mean(p_.process_scale);
  for (std::uint32_t r = 0; r < nx(); ++r)
    report.noise_sd[r] = noise_scale_ * std::sqrt(factor) * p_.cloud.config->process_sd[r];
}

}  // namespace tiller
