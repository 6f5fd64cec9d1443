#include "posterior/likelihood_shape.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/coordinates.hpp"

namespace tiller {

namespace {

/// Particles a coefficient below which the polynomial follows their noise.
constexpr double kParticlesPerTerm = 2.0;
/// Ridge over the normal equations' diagonal: against what the prior's bounds have flattened.
constexpr double kRidge = 1e-6;

}  // namespace

LikelihoodShape LikelihoodShape::lay_out(Arena& arena, std::uint32_t d) {
  LikelihoodShape s;
  s.d_ = d;
  s.curved_ = std::min(d, kMostCurvedCoordinates);
  s.terms_ = 1 + d + s.curved_ * (s.curved_ + 1) / 2;
  // as far as a posterior of d dimensions has its mass, as PolynomialDesign has it
  const double reach = 2.2 + 0.8 * std::sqrt(static_cast<double>(d));
  s.trusted_square_ = reach * reach;
  s.mean_ = arena.take<double>(d);
  s.root_ = arena.take<double>(std::size_t{d} * d);
  s.normal_ = arena.take<double>(std::size_t{s.terms_} * s.terms_);
  s.coefficient_ = arena.take<double>(s.terms_);
  return s;
}

/// False beyond what is trusted.
bool LikelihoodShape::monomials(const double* v, double* phi) const {
  double z[kMaxCoordinates] = {}, square = 0.0;
  for (std::uint32_t r = 0; r < d_; ++r) {
    double rest = v[r] - mean_[r];
    for (std::uint32_t k = 0; k < r; ++k) rest -= root_[r * d_ + k] * z[k];
    z[r] = rest / root_[r * d_ + r];
    square += z[r] * z[r];
  }
  *phi++ = 1.0;
  for (std::uint32_t r = 0; r < d_; ++r) *phi++ = z[r];
  for (std::uint32_t r = 0; r < curved_; ++r)
    for (std::uint32_t c = r; c < curved_; ++c) *phi++ = z[r] * z[c];
  return square <= trusted_square_;
}

void LikelihoodShape::fit(const Cloud& cloud, std::uint32_t first, std::uint32_t count, const double* mean,
                          const double* root, const double* log_likelihood) {
  fitted_ = false;
  if (count < kParticlesPerTerm * terms_) return;
  std::memcpy(mean_, mean, sizeof(double) * d_);
  std::memcpy(root_, root, sizeof(double) * d_ * d_);
  std::memset(normal_, 0, sizeof(double) * terms_ * terms_);
  std::memset(coefficient_, 0, sizeof(double) * terms_);
  double highest = -HUGE_VAL;
  const auto next = [&](std::uint32_t i) { return i + 1 < cloud.n ? i + 1 : 0; };
  for (std::uint32_t k = 0, i = first; k < count; ++k, i = next(i))
    if (cloud.weight[i] > 0.0) highest = std::fmax(highest, log_likelihood[i]);
  for (std::uint32_t k = 0, i = first; k < count; ++k, i = next(i)) {
    double v[kMaxCoordinates], phi[kMaxPolynomialTerms];
    for (std::uint32_t j = 0; j < d_; ++j) v[j] = cloud.coordinate[j * cloud.n + i];
    if (!(cloud.weight[i] > 0.0) || !monomials(v, phi)) continue;
    // a particle as far below the best as a posterior of d dimensions reaches says half as much, one beyond next to
    // nothing: they are on their way out
    const double below = (highest - log_likelihood[i]) / d_, share = cloud.weight[i] / (1.0 + below * below);
    for (std::uint32_t r = 0; r < terms_; ++r) {
      const double weighed = share * phi[r];
      coefficient_[r] += weighed * (log_likelihood[i] - highest);
      for (std::uint32_t c = 0; c <= r; ++c) normal_[r * terms_ + c] += weighed * phi[c];
    }
  }
  fitted_ = solve();
}

/// By a Cholesky factor in the place of the normal matrix.
bool LikelihoodShape::solve() {
  const std::uint32_t n = terms_;
  double* const x = coefficient_;
  const auto at = [this, n](std::uint32_t r, std::uint32_t c) -> double& { return normal_[r * n + c]; };
  for (std::uint32_t r = 0; r < n; ++r) {
    at(r, r) *= 1.0 + kRidge;
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = at(r, c);
      for (std::uint32_t k = 0; k < c; ++k) rest -= at(r, k) * at(c, k);
      if (r == c && !(rest > 0.0)) return false;
      at(r, c) = r == c ? std::sqrt(rest) : rest / at(c, c);
    }
    for (std::uint32_t k = 0; k < r; ++k) x[r] -= at(r, k) * x[k];
    x[r] /= at(r, r);
  }
  for (std::uint32_t r = n; r-- > 0;) {
    for (std::uint32_t k = r + 1; k < n; ++k) x[r] -= at(k, r) * x[k];
    x[r] /= at(r, r);
  }
  return std::isfinite(x[0]);
}

double LikelihoodShape::at(const double* v) const {
  double phi[kMaxPolynomialTerms];
  if (!monomials(v, phi)) return -HUGE_VAL;
  double sum = 0.0;
  for (std::uint32_t i = 0; i < terms_; ++i) sum += coefficient_[i] * phi[i];
  return sum;
}

}  // namespace tiller
