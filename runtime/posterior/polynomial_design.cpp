#include "posterior/polynomial_design.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/rng.hpp"

namespace tiller {

namespace {

/// Particles that say where the cloud is, evenly among all.
constexpr std::uint32_t kProbes = 256;
/// A design serves while the cloud's mean lies within this many deviations of its centre and the cloud's mean squares
/// along every direction stay between these shares of the design's.
constexpr double kFarthest = 0.7, kNarrowest = 0.3, kWidest = 2.0;
/// Stream of the design's directions: the same for everybody.
constexpr std::uint32_t kDesignStream = 11;
/// Share of the prior's deviation that a design has along every direction, whatever the cloud has.
constexpr double kLeastWidth = 1e-7;

/// Lower Cholesky factor of a positive definite n x n matrix, row-major. What rounding has left of a variance that
/// others explain is kept above zero.
void factorise(std::uint32_t n, const double* matrix, double* root) {
  for (std::uint32_t r = 0; r < n; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = matrix[r * n + c];
      for (std::uint32_t k = 0; k < c; ++k) rest -= root[r * n + k] * root[c * n + k];
      root[r * n + c] = r == c ? std::sqrt(std::fmax(rest, 1e-13 * matrix[r * n + r])) : rest / root[c * n + c];
    }
    for (std::uint32_t c = r + 1; c < n; ++c) root[r * n + c] = 0.0;
  }
}

std::uint32_t round_up(double value, std::uint32_t multiple) {
  const auto whole = static_cast<std::uint32_t>(std::ceil(value));
  return (whole + multiple - 1) / multiple * multiple;
}

}  // namespace

PolynomialDesign PolynomialDesign::lay_out(Arena& arena, std::uint32_t d, double points_per_term) {
  PolynomialDesign s;
  s.d_ = d;
  s.curved_ = std::min(d, kMostCurved);
  s.terms_ = 1 + d + s.curved_ * (s.curved_ + 1) / 2;
  s.points_ = round_up(points_per_term * s.terms_, 16);
  s.centre_ = arena.take<double>(d);
  s.root_ = arena.take<double>(std::size_t{d} * d);
  s.inverse_root_ = arena.take<double>(std::size_t{d} * d);
  s.unit_ = arena.take<double>(std::size_t{s.points_} * d);
  s.design_ = arena.take<double>(std::size_t{s.points_} * d);
  s.pseudo_inverse_ = arena.take<double>(std::size_t{s.terms_} * s.points_);
  s.translation_ = arena.take<double>(std::size_t{s.terms_} * s.terms_);
  s.square_ = arena.take<double>(std::size_t{2} * s.terms_ * s.terms_);
  if (arena.measuring() || !arena.fits()) return s;
  // directions at random, radii evenly in area up to a little beyond where a posterior of d dimensions has its mass
  const double reach = 2.2 + 0.8 * std::sqrt(static_cast<double>(d));
  s.trusted_square_ = 1.25 * 1.25 * reach * reach;
  for (std::uint32_t k = 0; k < s.points_; ++k) {
    Rng rng(0, kDesignStream, k);
    double norm = 0.0, direction[kMaxCoordinates];
    for (std::uint32_t j = 0; j < d; ++j) {
      direction[j] = rng.normal();
      norm += direction[j] * direction[j];
    }
    const double radius = reach * std::sqrt((k + 0.5) / s.points_);
    for (std::uint32_t j = 0; j < d; ++j) s.unit_[k * d + j] = direction[j] * radius / std::sqrt(norm);
  }
  return s;
}

void PolynomialDesign::whiten(const double* v, double* z) const {
  for (std::uint32_t r = 0; r < d_; ++r) {
    double rest = v[r] - centre_[r];
    for (std::uint32_t k = 0; k < r; ++k) rest -= root_[r * d_ + k] * z[k];
    z[r] = rest / root_[r * d_ + r];
  }
}

void PolynomialDesign::monomials(const double* z, double* phi) const {
  *phi++ = 1.0;
  for (std::uint32_t r = 0; r < d_; ++r) *phi++ = z[r];
  for (std::uint32_t r = 0; r < curved_; ++r)
    for (std::uint32_t c = r; c < curved_; ++c) *phi++ = z[r] * z[c];
}

bool PolynomialDesign::covers(const Cloud& cloud) const {
  if (!laid_) return false;
  const std::uint32_t stride = cloud.n > kProbes ? cloud.n / kProbes : 1;
  double mean[kMaxCoordinates] = {}, square[kMaxCoordinates] = {}, sum = 0.0;
  for (std::uint32_t i = 0; i < cloud.n; i += stride) {
    double v[kMaxCoordinates], z[kMaxCoordinates];
    for (std::uint32_t j = 0; j < d_; ++j) v[j] = cloud.coordinate[j * cloud.n + i];
    whiten(v, z);
    sum += cloud.weight[i];
    for (std::uint32_t j = 0; j < d_; ++j) {
      mean[j] += cloud.weight[i] * z[j];
      square[j] += cloud.weight[i] * z[j] * z[j];
    }
  }
  for (std::uint32_t j = 0; j < d_; ++j) {
    const double m = mean[j] / sum, variance = square[j] / sum - m * m;
    if (!(std::fabs(m) < kFarthest && variance > kNarrowest && variance < kWidest)) return false;
  }
  return true;
}

/// Weighted mean (d) of the cloud and the lower root (d x d) of its covariance.
void PolynomialDesign::find_moments(const Cloud& cloud, double* mean, double* root) const {
  double covariance[kMaxCoordinates * kMaxCoordinates];
  std::fill(covariance, covariance + std::size_t{d_} * d_, 0.0);
  const std::uint32_t n = cloud.n;
  for (std::uint32_t j = 0; j < d_; ++j) {
    mean[j] = 0.0;
    for (std::uint32_t i = 0; i < n; ++i) mean[j] += cloud.weight[i] * cloud.coordinate[j * n + i];
  }
  for (std::uint32_t r = 0; r < d_; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      const double *a = cloud.coordinate + r * n, *b = cloud.coordinate + c * n;
      for (std::uint32_t i = 0; i < n; ++i)
        covariance[r * d_ + c] += cloud.weight[i] * (a[i] - mean[r]) * (b[i] - mean[c]);
    }
    const double least = kLeastWidth * cloud.prior.spread(r);
    covariance[r * d_ + r] += least * least;
  }
  factorise(d_, covariance, root);
}

void PolynomialDesign::centre_on(const Cloud& cloud) {
  double mean[kMaxCoordinates], root[kMaxCoordinates * kMaxCoordinates];
  find_moments(cloud, mean, root);
  if (laid_) find_translation(mean, root);
  std::memcpy(centre_, mean, sizeof(double) * d_);
  std::memcpy(root_, root, sizeof(double) * d_ * d_);
  for (std::uint32_t c = 0; c < d_; ++c) {
    double column[kMaxCoordinates], z[kMaxCoordinates];
    for (std::uint32_t r = 0; r < d_; ++r) column[r] = centre_[r] + (r == c ? 1.0 : 0.0);
    whiten(column, z);
    for (std::uint32_t r = 0; r < d_; ++r) inverse_root_[r * d_ + c] = z[r];
  }
  place_points(cloud);
  invert();
  laid_ = true;
}

void PolynomialDesign::place_points(const Cloud& cloud) {
  for (std::uint32_t k = 0; k < points_; ++k) {
    for (std::uint32_t r = 0; r < d_; ++r) {
      double v = centre_[r];
      for (std::uint32_t c = 0; c <= r; ++c) v += root_[r * d_ + c] * unit_[k * d_ + c];
      const double low = cloud.prior.low(r), high = cloud.prior.high(r);
      if (v < low) v = 2.0 * low - v;
      if (v > high) v = 2.0 * high - v;
      design_[r * points_ + k] = v < low ? low : v;
    }
  }
}

/// (Phi' Phi + a little)^-1 Phi' of the design, which may have lost its shape at the prior's bounds.
void PolynomialDesign::invert() {
  double *normal = square_, *root = square_ + std::size_t{terms_} * terms_, phi[kMaxTerms] = {};
  std::memset(normal, 0, sizeof(double) * terms_ * terms_);
  for (std::uint32_t k = 0; k < points_; ++k) {
    double v[kMaxCoordinates], z[kMaxCoordinates];
    for (std::uint32_t j = 0; j < d_; ++j) v[j] = design_[j * points_ + k];
    whiten(v, z);
    monomials(z, phi);
    for (std::uint32_t r = 0; r < terms_; ++r) {
      pseudo_inverse_[r * points_ + k] = phi[r];
      for (std::uint32_t c = 0; c <= r; ++c) normal[r * terms_ + c] += phi[r] * phi[c];
    }
  }
  for (std::uint32_t r = 0; r < terms_; ++r) normal[r * terms_ + r] += 1e-9 * points_;
  factorise(terms_, normal, root);
  for (std::uint32_t k = 0; k < points_; ++k) {
    double* column = pseudo_inverse_ + k;
    for (std::uint32_t r = 0; r < terms_; ++r) {
      for (std::uint32_t c = 0; c < r; ++c) column[r * points_] -= root[r * terms_ + c] * column[c * points_];
      column[r * points_] /= root[r * terms_ + r];
    }
    for (std::uint32_t r = terms_; r-- > 0;) {
      for (std::uint32_t c = r + 1; c < terms_; ++c) column[r * points_] -= root[c * terms_ + r] * column[c * points_];
      column[r * points_] /= root[r * terms_ + r];
    }
  }
}

void PolynomialDesign::fit(const double* values, double* coefficients) const {
  for (std::uint32_t i = 0; i < terms_; ++i) {
    const double* row = pseudo_inverse_ + i * points_;
    double part[4] = {};
    for (std::uint32_t k = 0; k < points_; k += 4)
      for (std::uint32_t l = 0; l < 4; ++l) part[l] += row[k + l] * values[k + l];
    coefficients[i] = (part[0] + part[1]) + (part[2] + part[3]);
  }
}

/// z_before = A z_now + b, and so phi_before = T phi_now.
void PolynomialDesign::find_translation(const double* centre, const double* root) {
  double a[kMaxCoordinates * kMaxCoordinates] = {}, b[kMaxCoordinates];
  for (std::uint32_t c = 0; c <= d_; ++c) {
    double column[kMaxCoordinates], z[kMaxCoordinates];
    for (std::uint32_t r = 0; r < d_; ++r) column[r] = c < d_ ? centre_[r] + root[r * d_ + c] : centre[r];
    whiten(column, z);
    for (std::uint32_t r = 0; r < d_; ++r) (c < d_ ? a[r * d_ + c] : b[r]) = z[r];
  }
  double* t = translation_;
  std::memset(t, 0, sizeof(double) * terms_ * terms_);
  t[0] = 1.0;
  for (std::uint32_t r = 0; r < d_; ++r) {
    t[(1 + r) * terms_] = b[r];
    for (std::uint32_t c = 0; c < d_; ++c) t[(1 + r) * terms_ + 1 + c] = a[r * d_ + c];
  }
  std::uint32_t row = 1 + d_;
  for (std::uint32_t i = 0; i < curved_; ++i) {
    for (std::uint32_t j = i; j < curved_; ++j, ++row) {
      double* to = t + row * terms_;
      to[0] = b[i] * b[j];
      for (std::uint32_t k = 0; k < d_; ++k) to[1 + k] = b[i] * a[j * d_ + k] + b[j] * a[i * d_ + k];
      std::uint32_t column = 1 + d_;
      for (std::uint32_t k = 0; k < curved_; ++k)
        for (std::uint32_t l = k; l < curved_; ++l, ++column)
          to[column] = a[i * d_ + k] * a[j * d_ + l] + (k == l ? 0.0 : a[i * d_ + l] * a[j * d_ + k]);
    }
  }
}

void PolynomialDesign::add_square(const double* coefficients, double weight, double* triangle) const {
  for (std::uint32_t i = 0; i < terms_; ++i)
    for (std::uint32_t j = i; j < terms_; ++j) *triangle++ += weight * coefficients[i] * coefficients[j];
}

PolynomialJob PolynomialDesign::job(std::uint32_t lanes, const double* coordinate, std::uint32_t stride) const {
  PolynomialJob job;
  job.d = d_;
  job.terms = terms_;
  job.curved = curved_;
  job.lanes = lanes;
  job.centre = centre_;
  job.inverse_root = inverse_root_;
  job.trusted_square = trusted_square_;
  job.coordinate = coordinate;
  job.coordinate_stride = stride;
  return job;
}

void PolynomialDesign::translate(double* coefficients, double* scratch) const {
  for (std::uint32_t c = 0; c < terms_; ++c) {
    scratch[c] = 0.0;
    for (std::uint32_t k = 0; k < terms_; ++k) scratch[c] += translation_[k * terms_ + c] * coefficients[k];
  }
  std::memcpy(coefficients, scratch, sizeof(double) * terms_);
}

void PolynomialDesign::translate_form(double* triangle) const {
  double *full = square_, *half = square_ + std::size_t{terms_} * terms_;
  const double* t = translation_;
  for (std::uint32_t r = 0, i = 0; r < terms_; ++r)
    for (std::uint32_t c = r; c < terms_; ++c, ++i) full[r * terms_ + c] = full[c * terms_ + r] = triangle[i];
  for (std::uint32_t r = 0; r < terms_; ++r)
    for (std::uint32_t c = 0; c < terms_; ++c) {
      double sum = 0.0;
      for (std::uint32_t k = 0; k < terms_; ++k) sum += full[r * terms_ + k] * t[k * terms_ + c];
      half[r * terms_ + c] = sum;
    }
  for (std::uint32_t r = 0, i = 0; r < terms_; ++r)
    for (std::uint32_t c = r; c < terms_; ++c, ++i) {
      double sum = 0.0;
      for (std::uint32_t k = 0; k < terms_; ++k) sum += t[k * terms_ + r] * half[k * terms_ + c];
      triangle[i] = sum;
    }
}

}  // namespace tiller
