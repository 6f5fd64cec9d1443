#include "posterior/prior.hpp"

#include <cmath>
#include <limits>

#include "tiller/math.hpp"

namespace tiller {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool is_log(const tiller_prior_t& prior) { return prior.kind == tiller_prior_log_normal; }

/// The normal in the coordinate.
double centre(const tiller_prior_t& prior) { return is_log(prior) ? math::log(prior.a) : prior.a; }

/// Area of the standard normal above z.
double upper_tail(double z) { return 0.5 * math::erfc(z * 0.70710678118654752440); }

/// z in [low, high] below which lies the share u of the normal cut to [low, high]. Works with upper tails, and
/// mirrors intervals that lie left of the middle, so that no difference of numbers near one is taken.
double cut_normal_quantile(double low, double high, double u) {
  if (low + high < 0.0) return -cut_normal_quantile(-high, -low, 1.0 - u);
  // beyond 30 deviations the tail is below any double that matters
  double left = std::fmax(low, -30.0), right = std::fmin(high, std::fmax(30.0, left));
  const double above_low = upper_tail(left), above_high = upper_tail(right);
  const double target = above_low + u * (above_high - above_low);
  for (int i = 0; i < 64; ++i) {
    const double middle = 0.5 * (left + right);
    (upper_tail(middle) > target ? left : right) = middle;
  }
  return 0.5 * (left + right);
}

/// Reflected at the bounds until it lies between them.
double folded(double v, double low, double high) {
  if (v >= low && v <= high) return v;
  if (!std::isfinite(high)) return 2.0 * low - v;
  if (!std::isfinite(low)) return 2.0 * high - v;
  const double turn = std::fmod(std::fabs(v - low), 2.0 * (high - low));
  return std::fmin(std::fmax(low + (turn <= high - low ? turn : 2.0 * (high - low) - turn), low), high);
}

void shuffle(std::uint32_t* index, std::uint32_t n, Rng& rng) {
  for (std::uint32_t i = 0; i < n; ++i) index[i] = i;
  for (std::uint32_t i = n; i > 1; --i) {
    const std::uint32_t j = rng.below(i), swapped = index[i - 1];
    index[i - 1] = index[j];
    index[j] = swapped;
  }
}

}  // namespace

double to_coordinate(const tiller_prior_t& prior, double value) { return is_log(prior) ? math::log(value) : value; }

double from_coordinate(const tiller_prior_t& prior, double coordinate) {
  return is_log(prior) ? math::exp(coordinate) : coordinate;
}

double coordinate_low(const tiller_prior_t& prior) {
  if (is_log(prior)) return prior.low > 0.0 ? math::log(prior.low) : -kInfinity;
  return prior.low;
}

double coordinate_high(const tiller_prior_t& prior) { return is_log(prior) ? math::log(prior.high) : prior.high; }

double prior_spread(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? (prior.high - prior.low) / std::sqrt(12.0) : prior.b;
}

double log_prior(const tiller_prior_t& prior, double coordinate) {
  if (!(coordinate >= coordinate_low(prior) && coordinate <= coordinate_high(prior))) return -kInfinity;
  if (prior.kind == tiller_prior_fixed || prior.kind == tiller_prior_uniform) return 0.0;
  const double z = (coordinate - centre(prior)) / prior.b;
  return -0.5 * z * z;
}

double prior_quantile(const tiller_prior_t& prior, double u) {
  if (prior.kind == tiller_prior_fixed) return prior.a;
  if (prior.kind == tiller_prior_uniform) return prior.low + u * (prior.high - prior.low);
  const double low = (coordinate_low(prior) - centre(prior)) / prior.b;
  const double high = (coordinate_high(prior) - centre(prior)) / prior.b;
  return centre(prior) + prior.b * cut_normal_quantile(low, high, u);
}

PriorLaw::PriorLaw(const tiller_config_t& config) : config_(&config) {
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) inferred_[d_++] = i;
  if (config.prior_mixture) mixture_ = Mixture(*config.prior_mixture);
}

bool PriorLaw::within(const double* v) const {
  bool inside = true;
  for (std::uint32_t j = 0; j < d_; ++j) inside = inside && v[j] >= low(j) && v[j] <= high(j);
  return inside;
}

void PriorLaw::covariance(double* c) const {
  if (is_mixture()) return mixture_.covariance(c);
  for (std::uint32_t i = 0; i < d_ * d_; ++i) c[i] = 0.0;
  for (std::uint32_t j = 0; j < d_; ++j) c[j * d_ + j] = spread(j) * spread(j);
}

double PriorLaw::log_density(const double* v) const {
  if (is_mixture()) return within(v) ? mixture_.log_density(v) : -kInfinity;
  double sum = 0.0;
  for (std::uint32_t j = 0; j < d_; ++j) sum += log_prior(marginal(j), v[j]);
  return sum;
}

void PriorLaw::draw_one(Rng& rng, double* v) const {
  if (!is_mixture()) {
    for (std::uint32_t j = 0; j < d_; ++j) v[j] = prior_quantile(marginal(j), rng.uniform());
    return;
  }
  for (int i = 0; i < kTries; ++i) {
    mixture_.draw_one(rng, v);
    if (within(v)) return;
  }
  for (std::uint32_t j = 0; j < d_; ++j) v[j] = folded(v[j], low(j), high(j));
}

void PriorLaw::draw(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const {
  if (is_mixture()) return draw_mixture(seed, count, v, index);
  for (std::uint32_t j = 0; j < d_; ++j) {
    Rng rng(seed, kRngPrior, inferred_[j]);
    shuffle(index, count, rng);
    for (std::uint32_t k = 0; k < count; ++k)
      v[j * count + k] = prior_quantile(marginal(j), (index[k] + rng.uniform()) / count);
  }
}

void PriorLaw::draw_mixture(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const {
  Rng strata(seed, kRngPrior, TILLER_MAX_PARAMS), again(seed, kRngPrior, TILLER_MAX_PARAMS + 1);
  const double offset = mixture_.components() > 1 ? strata.uniform() : 0.5;
  const auto component = [&](std::uint32_t k) { return mixture_.component_at((k + offset) / count); };
  for (std::uint32_t j = 0; j < d_; ++j) {
    Rng rng(seed, kRngPrior, inferred_[j]);
    for (std::uint32_t begin = 0, end = 0; begin < count; begin = end) {
      while (end < count && component(end) == component(begin)) ++end;
      shuffle(index + begin, end - begin, rng);
      for (std::uint32_t k = begin; k < end; ++k)
        v[j * count + k] = cut_normal_quantile(-kInfinity, kInfinity, (index[k] + rng.uniform()) / (end - begin));
    }
  }
  for (std::uint32_t k = 0; k < count; ++k) {
    double one[TILLER_MAX_PARAMS];
    for (std::uint32_t j = 0; j < d_; ++j) one[j] = v[j * count + k];
    mixture_.place(component(k), one);
    if (!within(one)) draw_one(again, one);
    for (std::uint32_t j = 0; j < d_; ++j) v[j * count + k] = one[j];
  }
  // particles move in rotation, neighbours together: no component may keep to itself
  for (std::uint32_t k = mixture_.components() > 1 ? count : 0; k > 1; --k) {
    const std::uint32_t other = strata.below(k);
    for (std::uint32_t j = 0; j < d_; ++j) {
      const double swapped = v[j * count + k - 1];
      v[j * count + k - 1] = v[j * count + other];
      v[j * count + other] = swapped;
    }
  }
}

}  // namespace tiller
