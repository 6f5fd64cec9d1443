#include "posterior/sigma_points.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/rollout.hpp"

namespace tiller {
namespace {

constexpr int kMostSweeps = 30;       // of Jacobi's; six or so are enough
constexpr double kDiagonal = 1e-14;   // off the diagonal, of the diagonal
constexpr double kFarthest = 2.0;     // distance of a point whose partner is near a bound, over its own
constexpr double kLeastCentre = 0.5;  // of the centre's weight

std::uint32_t coordinates_of(const tiller_config_t& config) {
  std::uint32_t d = config.posterior.delay_hypotheses > 1 ? 1 : 0;
  for (std::uint32_t i = 0; i < config.param_count; ++i) d += config.priors[i].kind != tiller_prior_fixed ? 1u : 0u;
  return d;
}

std::uint32_t axes_of(const tiller_config_t& config) {
  const std::uint32_t pairs = config.planner.particles > 0 ? (config.planner.particles - 1) / 2 : 0;
  return std::min(coordinates_of(config), pairs);
}

/// c^2.
double spread_of_points(double axes) { return axes + std::fmax(3.0 - axes, 0.5); }

/// Turns rows and columns p, q of the symmetric a (n x n) so that a(p, q) is zero, and the columns of v with them
/// (Golub and Van Loan, "Matrix computations", 2013, section 8.5).
void rotate(std::uint32_t n, double* a, double* v, std::uint32_t p, std::uint32_t q) {
  const double apq = a[p * n + q], half = 0.5 * (a[q * n + q] - a[p * n + p]) / apq;
  const double t = (half >= 0.0 ? 1.0 : -1.0) / (std::fabs(half) + std::sqrt(1.0 + half * half));
  const double c = 1.0 / std::sqrt(1.0 + t * t), s = t * c;
  for (std::uint32_t i = 0; i < n; ++i) {
    const double ip = a[i * n + p], iq = a[i * n + q];
    a[i * n + p] = c * ip - s * iq;
    a[i * n + q] = s * ip + c * iq;
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    const double pi = a[p * n + i], qi = a[q * n + i], vp = v[i * n + p], vq = v[i * n + q];
    a[p * n + i] = c * pi - s * qi;
    a[q * n + i] = s * pi + c * qi;
    v[i * n + p] = c * vp - s * vq;
    v[i * n + q] = s * vp + c * vq;
  }
}

/// a becomes diagonal, its eigenvalues; the columns of v are the eigenvectors. What is not finite stays as it is.
void diagonalise(std::uint32_t n, double* a, double* v) {
  for (std::uint32_t i = 0; i < n * n; ++i) v[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
  for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
    bool done = true;
    for (std::uint32_t p = 0; p < n; ++p)
      for (std::uint32_t q = p + 1; q < n; ++q) {
        const double least = kDiagonal * std::sqrt(std::fabs(a[p * n + p] * a[q * n + q]));
        if (!(std::fabs(a[p * n + q]) > least)) continue;
        rotate(n, a, v, p, q);
        done = false;
      }
    if (done) return;
  }
}

}  // namespace

std::uint32_t SigmaPoints::count(const tiller_config_t& config) { return 2 * axes_of(config) + 1; }

void SigmaPoints::lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t effect_states) {
  if (config.planner.hypotheses != tiller_hypotheses_sigma_points) return;
  config_ = &config;
  prior_ = PriorDistribution(config);
  axes_ = axes_of(config);
  count_ = count(config);
  d_ = coordinates_of(config);
  named_ = prior_.named();
  nx_ = config.model->state_count;
  ns_ = effect_states;
  responses_ = nx_ + ns_ + 1;  // and the delay
  const std::uint32_t np = config.param_count;
  reference_ = arena.take<double>(np + nx_ + ns_ + 1);
  for (double** row : {&origin_, &scale_, &low_, &high_}) *row = arena.take<double>(d_);
  mean_ = arena.take<double>(d_ + responses_);
  covariance_ = arena.take<double>(std::size_t{d_} * d_);
  vectors_ = arena.take<double>(std::size_t{d_} * d_);
  cross_ = arena.take<double>(std::size_t{responses_} * d_);
  axis_ = arena.take<double>(std::size_t{axes_} * d_);
  slope_ = arena.take<double>(std::size_t{axes_} * responses_);
  variance_ = arena.take<double>(axes_);
  kept_ = arena.take<double>(axes_);
  particle_ = arena.take<double>(np + nx_ + ns_ + d_ + responses_);
  weight_ = arena.take<float>(count_);
  delay_ = arena.take<double>(count_);
  if (arena.measuring() || !arena.fits()) return;
  for (std::uint32_t i = 0, j = 0; i < np; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) inferred_[j++] = i;
  for (std::uint32_t j = 0; j < named_; ++j) {
    scale_[j] = 1.0 / prior_.spread(j);
    low_[j] = prior_.low(j);
    high_[j] = prior_.high(j);
  }
  // hypotheses of 0 to H - 1 periods, alike before anything is measured
  const double delays = config.posterior.delay_hypotheses;
  if (d_ > named_) scale_[named_] = 1.0 / std::sqrt((delays * delays - 1.0) / 12.0);
}

// ---- moments of the particles -------------------------------------------------------------------

void SigmaPoints::take_coordinates(const double* params, double delay, double* v) const {
  for (std::uint32_t j = 0; j < named_; ++j) v[j] = to_coordinate(prior_.marginal(j), params[inferred_[j]]);
  if (d_ > named_) v[named_] = delay;
}

void SigmaPoints::take_responses(const double* state, const double* effect_state, double delay, double* r) const {
  const double *from = reference_ + config_->param_count, *effects = from + nx_;
  state_differences(*config_->model, state, from, r);
  for (std::uint32_t i = 0; i < ns_; ++i) r[nx_ + i] = effect_state[i] - effects[i];
  r[nx_ + ns_] = delay - effects[ns_];
}

/// The heaviest particle: states that wrap average rightly about it.
void SigmaPoints::take_reference(const Posterior& posterior) {
  std::uint32_t heaviest = 0;
  double most = 0.0;
  for (std::uint32_t k = 0; k < posterior.size(); ++k) {
    double weight = 0.0;
    posterior.particle(k, nullptr, nullptr, &weight);
    if (weight > most) heaviest = k;
    most = std::fmax(most, weight);
  }
  double* const state = reference_ + config_->param_count;
  std::fill(reference_, state + nx_ + ns_ + 1, 0.0);
  posterior.particle(heaviest, reference_, state, nullptr);
  posterior.particle_effects(heaviest, state + nx_);
  state[nx_ + ns_] = posterior.particle_delay(heaviest);
  take_coordinates(reference_, state[nx_ + ns_], origin_);
}

void SigmaPoints::sum_particles(const Posterior& posterior) {
  const std::uint32_t all = d_ + responses_;
  double *const params = particle_, *const state = params + config_->param_count, *const effects = state + nx_,
                *const v = effects + ns_;
  std::fill(mean_, mean_ + all, 0.0);
  std::fill(covariance_, covariance_ + std::size_t{d_} * d_, 0.0);
  std::fill(cross_, cross_ + std::size_t{responses_} * d_, 0.0);
  std::fill(effects, effects + ns_, 0.0);
  double total = 0.0, earliest = HUGE_VAL, latest = -HUGE_VAL;
  for (std::uint32_t k = 0; k < posterior.size(); ++k) {
    double weight = 0.0;
    posterior.particle(k, params, state, &weight);
    if (!(weight > 0.0)) continue;
    posterior.particle_effects(k, effects);
    const double delay = posterior.particle_delay(k);
    take_coordinates(params, delay, v);
    for (std::uint32_t j = 0; j < d_; ++j) v[j] = (v[j] - origin_[j]) * scale_[j];
    take_responses(state, effects, delay, v + d_);
    if (!std::all_of(v, v + all, [](double x) { return std::isfinite(x); })) continue;
    total += weight;
    earliest = std::fmin(earliest, delay);
    latest = std::fmax(latest, delay);
    for (std::uint32_t i = 0; i < all; ++i) {
      const double w = weight * v[i];
      double* const row = i < d_ ? covariance_ + std::size_t{i} * d_ : cross_ + std::size_t{i - d_} * d_;
      mean_[i] += w;
      for (std::uint32_t j = 0; j < (i < d_ ? i + 1 : d_); ++j) row[j] += w * v[j];
    }
  }
  if (d_ > named_) {
    low_[named_] = earliest;
    high_[named_] = latest;
  }
  if (!(total > 0.0)) return;
  for (std::uint32_t i = 0; i < all; ++i) mean_[i] /= total;
  for (std::uint32_t i = 0; i < d_; ++i)
    for (std::uint32_t j = 0; j <= i; ++j)
      covariance_[i * d_ + j] = covariance_[j * d_ + i] = covariance_[i * d_ + j] / total - mean_[i] * mean_[j];
  for (std::uint32_t i = 0; i < responses_; ++i)
    for (std::uint32_t j = 0; j < d_; ++j) cross_[i * d_ + j] = cross_[i * d_ + j] / total - mean_[d_ + i] * mean_[j];
}

// ---- the axes -----------------------------------------------------------------------------------

/// Widest first, the largest element of each positive: a tick later the points stand in the same order.
void SigmaPoints::find_axes() {
  diagonalise(d_, covariance_, vectors_);
  for (std::uint32_t i = 0; i < axes_; ++i) {
    std::uint32_t widest = 0;
    for (std::uint32_t j = 1; j < d_; ++j)
      if (covariance_[j * d_ + j] > covariance_[widest * d_ + widest]) widest = j;
    double* const axis = axis_ + std::size_t{i} * d_;
    double largest = 0.0;
    for (std::uint32_t j = 0; j < d_; ++j) {
      axis[j] = vectors_[j * d_ + widest];
      if (std::fabs(axis[j]) > std::fabs(largest)) largest = axis[j];
    }
    for (std::uint32_t j = 0; j < d_ && largest < 0.0; ++j) axis[j] = -axis[j];
    variance_[i] = std::fmax(covariance_[widest * d_ + widest], 0.0);
    covariance_[widest * d_ + widest] = -1.0;  // taken
    for (std::uint32_t r = 0; r < responses_; ++r) {
      double sum = 0.0;
      for (std::uint32_t j = 0; j < d_; ++j) sum += cross_[r * d_ + j] * axis[j];
      slope_[i * responses_ + r] = variance_[i] > 0.0 ? sum / variance_[i] : 0.0;
    }
  }
}

/// How far the bounds leave from the mean along an axis, or against it.
double SigmaPoints::room(const double* axis, double sign) const {
  double least = HUGE_VAL;
  for (std::uint32_t j = 0; j < d_; ++j) {
    const double e = sign * axis[j] / scale_[j], at = origin_[j] + mean_[j] / scale_[j];
    if (e > 0.0) least = std::fmin(least, (high_[j] - at) / e);
    if (e < 0.0) least = std::fmin(least, (low_[j] - at) / e);
  }
  return std::fmax(least, 0.0);
}

SigmaPoints::Pair SigmaPoints::make_pair(std::uint32_t i) const {
  const double* axis = axis_ + std::size_t{i} * d_;
  const double square = spread_of_points(axes_) * variance_[i], reach = std::sqrt(square);
  const double above = room(axis, 1.0), below = room(axis, -1.0);
  Pair pair;
  pair.up = std::fmin(reach, above);
  pair.down = std::fmin(reach, below);
  if (pair.up < reach && pair.up > 0.0)
    pair.down = std::fmin(below, std::fmin(square / pair.up, kFarthest * reach));
  else if (pair.down < reach && pair.down > 0.0)
    pair.up = std::fmin(above, std::fmin(square / pair.down, kFarthest * reach));
  const double product = pair.up * pair.down;
  if (product > 0.0) {
    pair.weight = variance_[i] / product;
  } else {  // nothing to go along, or no room: two more centres
    pair.up = pair.down = 0.0;
    pair.weight = 1.0 / spread_of_points(axes_);
  }
  return pair;
}

/// Pairs that need more than the centre can give share what it can.
void SigmaPoints::weigh_pairs(Pair* pair) {
  const double each = 1.0 / spread_of_points(axes_), centre = 1.0 - axes_ * each;
  double more = 0.0;
  for (std::uint32_t i = 0; i < axes_; ++i) more += std::fmax(pair[i].weight - each, 0.0);
  const double most = (1.0 - kLeastCentre) * centre, share = more > most ? most / more : 1.0;
  for (std::uint32_t i = 0; i < axes_; ++i) {
    pair[i].weight = each + share * std::fmax(pair[i].weight - each, 0.0);
    kept_[i] = pair[i].weight * pair[i].up * pair[i].down;
  }
}

// ---- the points ---------------------------------------------------------------------------------

void SigmaPoints::write_point(const Posterior& posterior, std::uint32_t point, std::uint32_t i, double step,
                              float* params, float* state, float* effect_state) {
  const std::uint32_t np = config_->param_count;
  const double *const from = reference_ + np, *const axis = axis_ + std::size_t{i} * d_,
                      *const slope = slope_ + std::size_t{i} * responses_;
  double x[TILLER_MAX_STATES];
  for (std::uint32_t j = 0; j < np; ++j) params[j * count_ + point] = static_cast<float>(reference_[j]);
  for (std::uint32_t j = 0; j < named_; ++j) {
    const tiller_prior_t& prior = prior_.marginal(j);
    const double at = origin_[j] + (mean_[j] + (step != 0.0 ? step * axis[j] : 0.0)) / scale_[j];
    const double value = from_coordinate(prior, std::fmin(std::fmax(at, low_[j]), high_[j]));
    params[inferred_[j] * count_ + point] = static_cast<float>(std::fmin(std::fmax(value, prior.low), prior.high));
  }
  const auto response = [&](std::uint32_t r) { return mean_[d_ + r] + (step != 0.0 ? step * slope[r] : 0.0); };
  for (std::uint32_t r = 0; r < nx_; ++r) x[r] = response(r);
  add_differences(*config_->model, from, x, x);
  for (std::uint32_t r = 0; r < nx_; ++r) state[r * count_ + point] = static_cast<float>(x[r] - posterior.origin()[r]);
  for (std::uint32_t r = 0; r < ns_; ++r)
    effect_state[r * count_ + point] = static_cast<float>(from[nx_ + r] + response(nx_ + r));
  const double delay = from[nx_ + ns_] + response(nx_ + ns_);
  delay_[point] = d_ > named_ ? std::fmin(std::fmax(delay, low_[named_]), high_[named_]) : delay;
}

void SigmaPoints::draw(const Posterior& posterior, float* params, float* state, float* effect_state) {
  take_reference(posterior);
  sum_particles(posterior);
  find_axes();
  Pair pair[TILLER_MAX_PARAMS + 1];
  for (std::uint32_t i = 0; i < axes_; ++i) pair[i] = make_pair(i);
  weigh_pairs(pair);
  double rest = 1.0;
  for (std::uint32_t i = 0; i < axes_; ++i) {
    const Pair& p = pair[i];
    const double span = p.up + p.down, up_share = span > 0.0 ? p.down / span : 0.5;
    write_point(posterior, 2 * i + 1, i, p.up, params, state, effect_state);
    write_point(posterior, 2 * i + 2, i, -p.down, params, state, effect_state);
    weight_[2 * i + 1] = static_cast<float>(p.weight * up_share);
    weight_[2 * i + 2] = static_cast<float>(p.weight * (1.0 - up_share));
    rest -= p.weight;
  }
  write_point(posterior, 0, 0, 0.0, params, state, effect_state);
  weight_[0] = static_cast<float>(rest);
}

}  // namespace tiller
