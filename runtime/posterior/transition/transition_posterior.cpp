#include "posterior/transition/transition_posterior.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/bits.hpp"
#include "rollout/measurement.hpp"

namespace tiller {

TransitionPosterior* TransitionPosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                                  const RolloutTable& table, const tiller_hooks_t* hooks) {
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count, np = config.param_count;
  auto* p = arena.take<TransitionPosterior>(1);
  auto* particles = TransitionCloud::lay_out(arena, config, setup, table, hooks);
  const InputHistory inputs = InputHistory::lay_out(arena, config);
  auto* lane_params = arena.take<double>(np * kLanePadding);
  auto* lane_state = arena.take<double>(nx * kLanePadding);
  const bool tested = config.posterior.adequacy != 0 && config.posterior.enabled != 0;
  AdequacyTest* adequacy = tested ? AdequacyTest::lay_out(arena, config, true) : nullptr;
  if (arena.measuring() || !arena.fits()) return nullptr;
  p->config_ = &config;
  p->setup_ = setup;
  p->table_ = &table;
  p->n_ = config.posterior.particles;
  p->nx_ = nx;
  p->nu_ = nu;
  p->np_ = np;
  p->enabled_ = config.posterior.enabled != 0;
  p->particles_ = particles;
  p->inputs_ = inputs;
  p->lane_params_ = lane_params;
  p->lane_state_ = lane_state;
  p->adequacy_ = adequacy;
  p->rest_ = RestGuard(config);
  p->reset();
  return p;
}

tiller_status_t TransitionPosterior::check(const tiller_config_t& config, const StepSetup& setup,
                                           const RolloutTable& table, const char** field) {
  *field = "effects";
  if (has_sensor_effects(config)) return tiller_status_bad_effect;
  std::uint32_t seen = 0;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) seen |= 1u << config.measured_state[k];
  *field = "measurement";
  if (config.measurement_count != config.model->state_count || seen != low_bits(config.model->state_count))
    return tiller_status_bad_posterior;
  *field = "effects";
  if (setup.effect_state_count > 0) return tiller_status_bad_posterior;
  *field = "model";
  if (!table.residual) return tiller_status_bad_posterior;
  return tiller_status_ok;
}

void TransitionPosterior::reset() {
  particles_->reset(config_->posterior.forgetting_count > 0 ? config_->posterior.forgetting[0] : 1.0);
  clear_adequacy();
  started_ = complete_ = counted_ = false;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    state_[r] = config_->initial_state[r];
    unseen_variance_[r] = config_->initial_state_sd[r] * config_->initial_state_sd[r];
  }
}

void TransitionPosterior::restart(const double*) {
  particles_->restart();
  counted_ = false;
  clear_adequacy();
}

void TransitionPosterior::clear_adequacy() {
  if (adequacy_) adequacy_->reset();
  disturbances_.begin();
}

tiller_status_t TransitionPosterior::start(const double* measured) {
  for (std::uint32_t k = 0; k < nx_; ++k)
    if (std::isinf(measured[k])) return tiller_status_sensor_not_finite;
  complete_ = true;
  for (std::uint32_t k = 0; k < nx_; ++k) {
    const std::uint32_t r = config_->measured_state[k];
    const bool there = !std::isnan(measured[k]);
    complete_ = complete_ && there;
    state_[r] = there ? measured[k] : config_->initial_state[r];
    unseen_variance_[r] = there ? 0.0 : config_->initial_state_sd[r] * config_->initial_state_sd[r];
  }
  inputs_.begin(config_->safety.safe_command);
  if (adequacy_) adequacy_->begin();
  disturbances_.begin();
  for (double& speed : speed_) speed = 0.0;
  rest_.begin();
  counted_ = false;
  started_ = true;
  return tiller_status_ok;
}

tiller_status_t TransitionPosterior::skip(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  Transition unseen = transition;
  std::fill(unseen.measured, unseen.measured + nx_, NAN);
  const tiller_status_t refusal = check_transition(*config_, unseen);
  if (refusal != tiller_status_ok) return refusal;
  predict(transition);
  complete_ = counted_ = false;
  inputs_.push(transition.input);
  return tiller_status_ok;
}

tiller_status_t TransitionPosterior::update(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  tiller_status_t status = check_transition(*config_, transition);
  if (status != tiller_status_ok) return status;

  log_predictive_ = 0.0;
  MeasuredStep step;
  bool any = false, all = true;
  for (std::uint32_t k = 0; k < nx_; ++k) {
    const std::uint32_t r = config_->measured_state[k];
    const double y = transition.measured[k];
    step.state[r] = state_[r];
    step.change[r] = std::isnan(y) ? NAN : state_difference(*config_->model, r, y, state_[r]);
    any = any || !std::isnan(y);
    all = all && !std::isnan(y);
  }
  const bool resting = rest_.resting(transition), counted_before = counted_;
  counted_ = false;
  if (complete_ && any && !resting) {
    std::memcpy(step.input, transition.input, sizeof step.input);
    step.period_s = transition.period_s;
    step.history = inputs_.rows();
    status = particles_->update(step, counted_before);
    counted_ = status != tiller_status_posterior_degenerate;
    log_predictive_ = status == tiller_status_posterior_degenerate ? -INFINITY : particles_->log_predictive();
    if (adequacy_ && status != tiller_status_posterior_degenerate) test(step);
  } else if (particles_->exponent() < 1.0) {
    status = tiller_status_tempered;
  }
  if (!all) predict(transition);
  for (std::uint32_t k = 0; k < nx_; ++k) {
    const std::uint32_t r = config_->measured_state[k];
    if (std::isnan(transition.measured[k])) continue;
    state_[r] = transition.measured[k];
    unseen_variance_[r] = 0.0;
  }
  complete_ = all;
  inputs_.push(transition.input);
  return status;
}

/// One step of the model at the particles' mean, for states that were not measured.
void TransitionPosterior::predict(const Transition& transition) {
  double mean[TILLER_MAX_PARAMS];
  particles_->cloud().moments(mean, nullptr);
  for (std::uint32_t i = 0; i < np_; ++i)
    for (std::uint32_t l = 0; l < kLanePadding; ++l) lane_params_[i * kLanePadding + l] = mean[i];
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = kLanePadding;
  job.horizon = 1;
  job.period_s = transition.period_s;
  job.state = {state_, 0};
  job.params = {lane_params_, kLanePadding};
  job.controls = {transition.input, 0};
  job.history = inputs_.rows();
  job.final_state = lane_state_;
  table_->rollout_f64(*config_->model, job);
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double next = lane_state_[r * kLanePadding];
    if (std::isfinite(next)) state_[r] = next;
    unseen_variance_[r] += particles_->noise_variance(r);
  }
}

/// Measured states forget nothing over a step, so a disturbance stands in one innovation and no other.
void TransitionPosterior::test(const MeasuredStep& step) {
  Innovation now;
  const bool doubted = particles_->robust_weight() < 1.0;
  for (std::uint32_t k = 0; k < nx_; ++k) {
    now.normalised[k] = doubted ? NAN : particles_->innovation()[config_->measured_state[k]];
  }
  // speeds of the step before: the noise of the state where this step begins is in its innovation too
  disturbances_.observe(nx_, nu_, speed_, nullptr, step.input, now.response);
  for (std::uint32_t k = 0; k < nx_; ++k) {
    const std::uint32_t r = config_->measured_state[k], rate = velocity_state(*config_->model, r);
    speed_[k] = rate < nx_ ? step.state[rate] : step.state[r];
  }
  adequacy_->take(now);
}

void TransitionPosterior::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  particles_->cloud().moments(param_mean, param_sd);
  for (std::uint32_t r = 0; r < nx_; ++r) {
    if (state_mean) state_mean[r] = state_[r];
    // how much of the residuals' noise is the sensor's is not known: all of it might be
    if (state_sd) state_sd[r] = std::sqrt(particles_->noise_variance(r) + unseen_variance_[r]);
  }
}

/// Root of the mean over the states of estimated over configured variance.
double TransitionPosterior::noise_scale() const {
  double sum = 0.0;
  for (std::uint32_t r = 0; r < nx_; ++r)
    sum += particles_->noise_variance(r) / particles_->evidence().configured_variance(r);
  return std::sqrt(sum / nx_);
}

void TransitionPosterior::particle(std::uint32_t index, double* params, double* state, double* weight) const {
  if (index >= n_) return;
  for (std::uint32_t i = 0; i < np_ && params; ++i) params[i] = particles_->cloud().params[i * n_ + index];
  for (std::uint32_t r = 0; r < nx_ && state; ++r) state[r] = state_[r];
  if (weight) *weight = particles_->cloud().weight[index];
}

void TransitionPosterior::draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float*,
                               float* history) const {
  if (count == 1) {
    double mean[TILLER_MAX_PARAMS];
    particles_->cloud().moments(mean, nullptr);
    for (std::uint32_t i = 0; i < np_ && params; ++i) params[i] = static_cast<float>(mean[i]);
  } else {
    const Cloud::Drawn what[] = {{particles_->cloud().params, np_, params}};
    particles_->cloud().draw(count, tick, what, 1);
  }
  for (std::uint32_t r = 0; r < nx_ && state; ++r)
    for (std::uint32_t m = 0; m < count; ++m) state[r * count + m] = static_cast<float>(state_[r] - origin()[r]);
  inputs_.copy(setup_.delay_steps, history);
}

void TransitionPosterior::report(PosteriorReport& report) const {
  report = {};
  for (std::uint32_t r = 0; r < nx_; ++r)
    report.noise_sd[r] = std::sqrt(particles_->noise_variance(r) / config_->period_s);
  report.delay_weight[0] = report.forgetting_weight[0] = 1.0;
  report.discrepancy_share = particles_->discrepancy_share();
  report.lost = particles_->lost();
}

}  // namespace tiller
