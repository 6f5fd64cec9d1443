// The likelihood, its exponent, the weights and the resampling.

#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "posterior/posterior.hpp"

namespace tiller {

namespace {

/// Steps of the search for an exponent below the present one, each this factor down, and of the bisection after.
constexpr double kFall = 0.7;
constexpr int kFallSteps = 20;
constexpr int kBisections = 10;

}  // namespace

/// Innovations with variance sigma^2 s_k and sigma^2 ~ InvGamma(a0, a0) have, sigma^2 integrated out, the log
/// density  -(a0 + n/2) log(a0 + sum e_k^2 / (2 s_k)) - sum log(s_k) / 2  up to a constant of n and a0.
double Posterior::log_likelihood(double squared_error, double log_variance) const {
  const double a0 = config_->posterior.noise_scale_shape;
  return -(a0 + 0.5 * static_cast<double>(scalars_)) * std::log(a0 + 0.5 * squared_error) - 0.5 * log_variance;
}

/// target = prior x likelihood^exponent. Weights follow the change of the target since the last tick.
tiller_status_t Posterior::reweight() {
  double* base = scratch_row(0);
  double* gain = scratch_row(1);
  bool any_finite = false, any_dead = false;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double updated = log_likelihood(cloud_.squared_error[i], cloud_.log_variance[i]);
    const bool alive = std::isfinite(updated) && std::isfinite(cloud_.log_weight[i]);
    base[i] = alive ? cloud_.log_weight[i] - exponent_ * cloud_.log_likelihood[i] : -INFINITY;
    gain[i] = alive ? updated : 0.0;
    any_finite = any_finite || alive;
    any_dead = any_dead || !alive;
    // a frozen particle that met a state that is not finite tries again from the state it had
    if (!enabled_ && !alive) {
      cloud_.squared_error[i] = scratch_row(2)[i];
      cloud_.log_variance[i] = scratch_row(3)[i];
    }
  }
  if (!any_finite) {
    std::memcpy(cloud_.squared_error, scratch_row(2), n_ * sizeof(double));
    std::memcpy(cloud_.log_variance, scratch_row(3), n_ * sizeof(double));
    for (std::uint32_t k = 0; k < ny_; ++k) scalars_ -= std::isnan(now_.measured[k]) ? 0u : 1u;
    return tiller_status_posterior_degenerate;
  }
  if (!enabled_) {
    measure_noise();
    return tiller_status_ok;
  }

  const double floor = config_->posterior.ess_fraction * n_;
  const bool can_move = config_->posterior.moves_per_tick > 0 && d_ > 0;
  const bool swept = moved_ >= n_;
  // a raised exponent needs a cloud that has moved since the last change: particles that only were copied look
  // like agreement, and the target outruns them
  const double high = swept ? 1.0 : exponent_;
  double chosen = high;
  double ess = filter_->weigh(n_, base, gain, high, nullptr).effective_samples;
  const bool ordinary = !can_move || (swept && exponent_ == 1.0 && ess >= 0.5 * floor);
  if (ess < floor && !ordinary) chosen = largest_exponent(base, gain, high, floor);
  set_weights(base, gain, chosen);
  if (chosen != exponent_) moved_ = 0;
  exponent_ = chosen;
  for (std::uint32_t i = 0; i < n_; ++i) cloud_.log_likelihood[i] = std::isinf(base[i]) ? 0.0 : gain[i];
  // a particle whose state is not finite is replaced at once: moves and fits then find every particle alive
  if (effective_samples_ < floor || chosen < high || any_dead) resample();
  measure_noise();
  return exponent_ < 1.0 ? tiller_status_tempered : tiller_status_ok;
}

void Posterior::set_weights(const double* base, const double* gain, double exponent) {
  const WeighResult result = filter_->weigh(n_, base, gain, exponent, cloud_.weight);
  const double log_sum = result.largest + std::log(result.sum);
  for (std::uint32_t i = 0; i < n_; ++i) {
    cloud_.weight[i] /= result.sum;
    cloud_.log_weight[i] = base[i] + exponent * gain[i] - log_sum;
  }
  effective_samples_ = result.effective_samples;
}

/// The largest exponent up to `high` that leaves `floor` effective samples. The number of effective samples is not
/// monotone in the exponent (far below the present one the old data are unlearnt), so the search goes down in
/// steps and bisects the first one that is low enough; if none is, the best of them.
double Posterior::largest_exponent(const double* base, const double* gain, double high, double floor) {
  auto ess = [&](double exponent) { return filter_->weigh(n_, base, gain, exponent, nullptr).effective_samples; };
  double good = exponent_, bad = high;
  if (!(good < high && ess(good) >= floor)) {
    double best = 0.0, best_exponent = high;
    bad = good = exponent_;
    for (int i = 0; i < kFallSteps; ++i) {
      const double here = ess(good);
      if (here > best) {
        best = here;
        best_exponent = good;
      }
      if (here >= floor) break;
      bad = good;
      good *= kFall;
    }
    if (best < floor) return best_exponent;
  }
  for (int i = 0; i < kBisections && bad > good; ++i) {
    const double middle = 0.5 * (good + bad);
    (ess(middle) >= floor ? good : bad) = middle;
  }
  return good;
}

/// Systematic resampling: one uniform number, N evenly spaced pointers into the cumulated weights.
void Posterior::resample() {
  Rng rng(config_->seed, kRngResample, tick_);
  const double offset = rng.uniform();
  double sum = 0.0;
  std::uint32_t next = 0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    sum += cloud_.weight[i] * n_;
    while (next < n_ && (next + offset < sum)) index_[next++] = i;
  }
  // rounding may leave the last pointer beyond the sum: it belongs to the last particle that has any weight
  std::uint32_t last = n_ - 1;
  while (last > 0 && !(cloud_.weight[last] > 0.0)) --last;
  while (next < n_) index_[next++] = last;

  for (std::uint32_t j = 0; j < d_; ++j) {
    permute(cloud_.params + inferred_[j] * n_);
    permute(cloud_.coordinate + j * n_);
  }
  for (std::uint32_t i = 0; i < nx_; ++i) permute(cloud_.filter.state + i * n_);
  for (std::uint32_t i = 0; i < triangle_; ++i) permute(cloud_.filter.covariance + i * n_);
  for (std::uint32_t i = 0; i < ns_; ++i) permute(cloud_.filter.effect_state + i * n_);
  permute(cloud_.squared_error);
  permute(cloud_.log_variance);
  permute(cloud_.base_squared_error);
  permute(cloud_.base_log_variance);
  permute(cloud_.log_likelihood);
  for (std::uint32_t i = 0; i < n_; ++i) {
    cloud_.log_weight[i] = 0.0;
    cloud_.weight[i] = 1.0 / n_;
  }
  effective_samples_ = n_;
  moved_ = 0;
  ++resamplings_;
}

void Posterior::permute(double* row) {
  double* from = scratch_row(0);
  std::memcpy(from, row, n_ * sizeof(double));
  for (std::uint32_t i = 0; i < n_; ++i) row[i] = from[index_[i]];
}

/// E[sigma^2] over the particles: the mean of InvGamma(a0 + n/2, a0 + sse/2).
void Posterior::measure_noise() {
  const double a0 = config_->posterior.noise_scale_shape;
  const double shape = a0 + 0.5 * static_cast<double>(scalars_);
  double sum = 0.0, weight = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    if (!(cloud_.weight[i] > 0.0) || !std::isfinite(cloud_.squared_error[i])) continue;
    sum += cloud_.weight[i] * (a0 + 0.5 * cloud_.squared_error[i]);
    weight += cloud_.weight[i];
  }
  // the mean exists from shape 1 on; before that the ratio of the two stands in its place
  if (weight > 0.0) noise_scale_ = std::sqrt(sum / weight / (shape > 2.0 ? shape - 1.0 : shape));
}

}  // namespace tiller
