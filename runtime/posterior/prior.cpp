#include "posterior/prior.hpp"

#include <cmath>
#include <limits>

#include "tiller/math.hpp"

namespace tiller {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kLogTwoPi = 1.83787706640934548;

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

PriorDistribution::PriorDistribution(const tiller_config_t& config, const ExtraCoordinates& extra)
    : config_(&config), extra_(extra) {
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) inferred_[named_++] = i;
  d_ = named_ + extra.count;
  if (config.prior_mixture) mixture_ = Mixture(*config.prior_mixture);
}

bool PriorDistribution::within(const double* v) const {
  bool inside = true;
  for (std::uint32_t j = 0; j < named_; ++j) inside = inside && v[j] >= low(j) && v[j] <= high(j);
  return inside;
}

void PriorDistribution::covariance(double* c) const {
  for (std::uint32_t i = 0; i < d_ * d_; ++i) c[i] = 0.0;
  for (std::uint32_t j = 0; j < d_; ++j) c[j * d_ + j] = spread(j) * spread(j);
  if (!is_mixture()) return;
  double joint[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS];
  mixture_.covariance(joint);
  for (std::uint32_t r = 0; r < named_; ++r)
    for (std::uint32_t s = 0; s < named_; ++s) c[r * d_ + s] = joint[r * named_ + s];
}

NormalLaw NormalLaw::lay_out(Arena& arena, std::uint32_t d) {
  NormalLaw law;
  law.d = d;
  law.mean = arena.take<double>(d);
  law.root = arena.take<double>(std::size_t{d} * d);
  return law;
}

double NormalLaw::log_density(const double* v) const {
  double z[kMaxCoordinates], sum = -0.5 * d * kLogTwoPi;
  for (std::uint32_t r = 0; r < d; ++r) {
    double rest = v[r] - mean[r];
    for (std::uint32_t k = 0; k < r; ++k) rest -= root[r * d + k] * z[k];
    z[r] = rest / root[r * d + r];
    sum -= 0.5 * z[r] * z[r] + math::log(root[r * d + r]);
  }
  return sum;
}

double PriorDistribution::log_density(const double* v) const {
  return before_ ? changed_log_density(v) : configured_log_density(v);
}

/// Logarithm of the factor that normalises configured_log_density() over the named coordinates; of a mixture as if it
/// were not cut.
double PriorDistribution::log_scale() const {
  if (is_mixture()) return mixture_.log_scale() - 0.5 * named_ * kLogTwoPi;
  double sum = 0.0;
  for (std::uint32_t j = 0; j < named_; ++j) {
    const tiller_prior_t& p = marginal(j);
    if (p.kind == tiller_prior_uniform) {
      sum -= math::log(p.high - p.low);
      continue;
    }
    const double low_z = (low(j) - centre(p)) / p.b, high_z = (high(j) - centre(p)) / p.b;
    sum -= math::log(p.b) + 0.5 * kLogTwoPi + math::log(upper_tail(low_z) - upper_tail(high_z));
  }
  return sum;
}

/// log(1/2 before(v) + 1/2 configured(named) before(extra)).
double PriorDistribution::changed_log_density(const double* v) const {
  double configured = configured_log_density(v);
  if (std::isinf(configured)) return configured;
  configured += log_scale();
  for (std::uint32_t j = named_; j < d_; ++j) {
    // the marginal's variance is the square of the root's row; the configured marginal's share goes
    double variance = 0.0;
    for (std::uint32_t k = 0; k <= j; ++k) variance += before_->root[j * d_ + k] * before_->root[j * d_ + k];
    const double off = v[j] - before_->mean[j];
    configured += -0.5 * (off * off / variance + math::log(variance) + kLogTwoPi) - log_prior(marginal(j), v[j]);
  }
  const double before = before_->log_density(v), larger = std::fmax(before, configured);
  return larger + math::log(0.5 * math::exp(before - larger) + 0.5 * math::exp(configured - larger));
}

double PriorDistribution::configured_log_density(const double* v) const {
  if (is_mixture() && !within(v)) return -kInfinity;
  double sum = is_mixture() ? mixture_.log_density(v) : 0.0;
  for (std::uint32_t j = is_mixture() ? named_ : 0; j < d_; ++j) sum += log_prior(marginal(j), v[j]);
  return sum;
}

void PriorDistribution::draw_one(Rng& rng, double* v) const {
  for (std::uint32_t j = is_mixture() ? named_ : 0; j < d_; ++j) v[j] = prior_quantile(marginal(j), rng.uniform());
  if (!is_mixture()) return;
  for (int i = 0; i < kTries; ++i) {
    mixture_.draw_one(rng, v);
    if (within(v)) return;
  }
  for (std::uint32_t j = 0; j < named_; ++j) v[j] = folded(v[j], low(j), high(j));
}

void PriorDistribution::draw(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const {
  if (is_mixture()) draw_mixture(seed, count, v, index);
  for (std::uint32_t j = is_mixture() ? named_ : 0; j < d_; ++j) {
    Rng rng(seed, kRngPrior, j < named_ ? prior_stream(inferred_[j]) : kPriorExtra + (j - named_));
    shuffle(index, count, rng);
    for (std::uint32_t k = 0; k < count; ++k)
      v[j * count + k] = prior_quantile(marginal(j), (index[k] + rng.uniform()) / count);
  }
}

void PriorDistribution::draw_mixture(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const {
  Rng strata(seed, kRngPrior, kPriorStrata), again(seed, kRngPrior, kPriorRepeat);
  const double offset = mixture_.components() > 1 ? strata.uniform() : 0.5;
  const auto component = [&](std::uint32_t k) { return mixture_.component_at((k + offset) / count); };
  for (std::uint32_t j = 0; j < named_; ++j) {
    Rng rng(seed, kRngPrior, prior_stream(inferred_[j]));
    for (std::uint32_t begin = 0, end = 0; begin < count; begin = end) {
      while (end < count && component(end) == component(begin)) ++end;
      shuffle(index + begin, end - begin, rng);
      for (std::uint32_t k = begin; k < end; ++k)
        v[j * count + k] = cut_normal_quantile(-kInfinity, kInfinity, (index[k] + rng.uniform()) / (end - begin));
    }
  }
  for (std::uint32_t k = 0; k < count; ++k) {
    double one[TILLER_MAX_PARAMS];
    for (std::uint32_t j = 0; j < named_; ++j) one[j] = v[j * count + k];
    mixture_.place(component(k), one);
    if (!within(one)) draw_one(again, one);
    for (std::uint32_t j = 0; j < named_; ++j) v[j * count + k] = one[j];
  }
  // particles move in rotation, neighbours together: no component may keep to itself
  for (std::uint32_t k = mixture_.components() > 1 ? count : 0; k > 1; --k) {
    const std::uint32_t other = strata.below(k);
    for (std::uint32_t j = 0; j < named_; ++j) {
      const double swapped = v[j * count + k - 1];
      v[j * count + k - 1] = v[j * count + other];
      v[j * count + other] = swapped;
    }
  }
}

}  // namespace tiller
