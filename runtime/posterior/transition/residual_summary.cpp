#include "posterior/transition/residual_summary.hpp"

#include <cmath>
#include <cstring>

#include "core/rng.hpp"

namespace tiller {

namespace {

constexpr std::uint32_t kMax = TILLER_MAX_PARAMS;
/// Particles that say where the cloud is, evenly among all.
constexpr std::uint32_t kProbes = 256;
/// A design serves while the cloud's mean lies within this many deviations of its centre and the cloud's mean squares
/// along every direction stay between these shares of the design's.
constexpr double kFarthest = 0.7, kNarrowest = 0.3, kWidest = 2.0;
/// Stream of the design's directions: the same for everybody.
constexpr std::uint32_t kDesignStream = 11;

/// Lower Cholesky factor of a d x d matrix, row-major; false where it is not positive definite.
bool factorise(std::uint32_t d, const double* matrix, double* root) {
  for (std::uint32_t r = 0; r < d; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = matrix[r * d + c];
      for (std::uint32_t k = 0; k < c; ++k) rest -= root[r * d + k] * root[c * d + k];
      if (r != c) {
        root[r * d + c] = rest / root[c * d + c];
        continue;
      }
      if (!(rest > 1e-13 * matrix[r * d + r])) return false;
      root[r * d + r] = std::sqrt(rest);
    }
    for (std::uint32_t c = r + 1; c < d; ++c) root[r * d + c] = 0.0;
  }
  return true;
}

}  // namespace

ResidualSummary ResidualSummary::lay_out(Arena& arena, std::uint32_t d, std::uint32_t nx, std::uint32_t joints,
                                         const std::uint32_t* velocity) {
  ResidualSummary s;
  s.d_ = d;
  s.nx_ = nx;
  s.joints_ = joints;
  s.projections_ = joints * joints * kDiscrepancyBasis;
  for (std::uint32_t j = 0; j < joints; ++j) s.velocity_[j] = velocity[j];
  s.quadratic_ = 1 + d + d * (d + 1) / 2 <= kMaxTerms;
  s.terms_ = s.quadratic_ ? 1 + d + d * (d + 1) / 2 : 1 + d;
  s.triangle_ = s.terms_ * (s.terms_ + 1) / 2;
  const std::uint32_t wanted = (4 * s.terms_ + 15) / 16 * 16;
  s.points_ = wanted < 32 ? 32 : wanted;
  s.unit_ = arena.take<double>(s.points_ * d);
  s.design_ = arena.take<double>(s.points_ * d);
  s.pseudo_inverse_ = arena.take<double>(s.terms_ * s.points_);
  s.candidate_ = arena.take<double>(s.terms_ * s.points_);
  s.gram_ = arena.take<double>(nx * s.triangle_);
  s.tilt_ = arena.take<double>(s.projections_ * s.terms_);
  if (arena.measuring() || !arena.fits()) return s;
  // directions at random, radii evenly in area up to a little beyond where a posterior of d dimensions has its mass
  const double reach = 2.2 + 0.8 * std::sqrt(static_cast<double>(d));
  for (std::uint32_t k = 0; k < s.points_; ++k) {
    Rng rng(0, kDesignStream, k);
    double norm = 0.0, direction[kMax];
    for (std::uint32_t j = 0; j < d; ++j) {
      direction[j] = rng.normal();
      norm += direction[j] * direction[j];
    }
    const double radius = reach * std::sqrt((k + 0.5) / s.points_);
    for (std::uint32_t j = 0; j < d; ++j) s.unit_[k * d + j] = direction[j] * radius / std::sqrt(norm);
  }
  return s;
}

void ResidualSummary::clear() {
  std::memset(gram_, 0, sizeof(double) * nx_ * triangle_);
  std::memset(tilt_, 0, sizeof(double) * projections_ * terms_);
  empty_ = true;
  laid_ = false;
}

void ResidualSummary::forget(double keep) {
  if (keep == 1.0 || empty_) return;
  for (std::uint32_t i = 0; i < nx_ * triangle_; ++i) gram_[i] *= keep;
  for (std::uint32_t i = 0; i < projections_ * terms_; ++i) tilt_[i] *= keep;
}

void ResidualSummary::whiten(const double* v, double* z) const {
  for (std::uint32_t r = 0; r < d_; ++r) {
    double rest = v[r] - centre_[r];
    for (std::uint32_t k = 0; k < r; ++k) rest -= root_[r * d_ + k] * z[k];
    z[r] = rest / root_[r * d_ + r];
  }
}

void ResidualSummary::monomials(const double* z, double* phi) const {
  *phi++ = 1.0;
  for (std::uint32_t r = 0; r < d_; ++r) *phi++ = z[r];
  for (std::uint32_t r = 0; r < d_ && quadratic_; ++r)
    for (std::uint32_t c = r; c < d_; ++c) *phi++ = z[r] * z[c];
}

bool ResidualSummary::covers(const Cloud& cloud) const {
  if (!laid_) return false;
  const std::uint32_t stride = cloud.n > kProbes ? cloud.n / kProbes : 1;
  double mean[kMax] = {}, square[kMax] = {}, sum = 0.0;
  for (std::uint32_t i = 0; i < cloud.n; i += stride) {
    double v[kMax], z[kMax];
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

bool ResidualSummary::centre_on(const Cloud& cloud) {
  double mean[kMax] = {}, covariance[kMax * kMax] = {}, root[kMax * kMax];
  const std::uint32_t n = cloud.n;
  for (std::uint32_t j = 0; j < d_; ++j)
    for (std::uint32_t i = 0; i < n; ++i) mean[j] += cloud.weight[i] * cloud.coordinate[j * n + i];
  for (std::uint32_t r = 0; r < d_; ++r)
    for (std::uint32_t c = 0; c <= r; ++c) {
      const double *a = cloud.coordinate + r * n, *b = cloud.coordinate + c * n;
      for (std::uint32_t i = 0; i < n; ++i)
        covariance[r * d_ + c] += cloud.weight[i] * (a[i] - mean[r]) * (b[i] - mean[c]);
    }
  if (!factorise(d_, covariance, root)) return false;

  if (!empty_) translate(mean, root);
  std::memcpy(centre_, mean, sizeof(double) * d_);
  std::memcpy(root_, root, sizeof(double) * d_ * d_);
  for (std::uint32_t c = 0; c < d_; ++c) {
    double column[kMax], z[kMax];
    for (std::uint32_t r = 0; r < d_; ++r) column[r] = centre_[r] + (r == c ? 1.0 : 0.0);
    whiten(column, z);
    for (std::uint32_t r = 0; r < d_; ++r) inverse_root_[r * d_ + c] = z[r];
  }
  for (std::uint32_t k = 0; k < points_; ++k) {
    for (std::uint32_t r = 0; r < d_; ++r) {
      double v = mean[r];
      for (std::uint32_t c = 0; c <= r; ++c) v += root[r * d_ + c] * unit_[k * d_ + c];
      const double low = cloud.prior.low(r), high = cloud.prior.high(r);
      if (v < low) v = 2.0 * low - v;
      if (v > high) v = 2.0 * high - v;
      design_[r * points_ + k] = v < low ? low : v;
    }
  }
  laid_ = invert_design(design_, pseudo_inverse_);
  return laid_;
}

/// (Phi' Phi + a little)^-1 Phi' of the design, which may have lost its shape at the prior's bounds.
bool ResidualSummary::invert_design(const double* design, double* pseudo_inverse) const {
  double normal[kMaxTerms * kMaxTerms] = {}, root[kMaxTerms * kMaxTerms], phi[kMaxTerms];
  for (std::uint32_t k = 0; k < points_; ++k) {
    double v[kMax], z[kMax];
    for (std::uint32_t j = 0; j < d_; ++j) v[j] = design[j * points_ + k];
    whiten(v, z);
    monomials(z, phi);
    for (std::uint32_t r = 0; r < terms_; ++r) {
      pseudo_inverse[r * points_ + k] = phi[r];
      for (std::uint32_t c = 0; c <= r; ++c) normal[r * terms_ + c] += phi[r] * phi[c];
    }
  }
  for (std::uint32_t r = 0; r < terms_; ++r) normal[r * terms_ + r] += 1e-9 * points_;
  if (!factorise(terms_, normal, root)) return false;
  for (std::uint32_t k = 0; k < points_; ++k) {
    double* column = pseudo_inverse + k;
    for (std::uint32_t r = 0; r < terms_; ++r) {
      for (std::uint32_t c = 0; c < r; ++c) column[r * points_] -= root[r * terms_ + c] * column[c * points_];
      column[r * points_] /= root[r * terms_ + r];
    }
    for (std::uint32_t r = terms_; r-- > 0;) {
      for (std::uint32_t c = r + 1; c < terms_; ++c) column[r * points_] -= root[c * terms_ + r] * column[c * points_];
      column[r * points_] /= root[r * terms_ + r];
    }
  }
  return true;
}

/// z_before = A z_now + b, and so phi_before = T phi_now: G_now = T' G T, t_now = T' t.
void ResidualSummary::translate(const double* centre, const double* root) {
  double a[kMax * kMax] = {}, b[kMax];
  for (std::uint32_t c = 0; c <= d_; ++c) {
    double column[kMax], z[kMax];
    for (std::uint32_t r = 0; r < d_; ++r) column[r] = c < d_ ? centre_[r] + root[r * d_ + c] : centre[r];
    whiten(column, z);
    for (std::uint32_t r = 0; r < d_; ++r) (c < d_ ? a[r * d_ + c] : b[r]) = z[r];
  }
  double t[kMaxTerms * kMaxTerms] = {};
  t[0] = 1.0;
  for (std::uint32_t r = 0; r < d_; ++r) {
    t[(1 + r) * terms_] = b[r];
    for (std::uint32_t c = 0; c < d_; ++c) t[(1 + r) * terms_ + 1 + c] = a[r * d_ + c];
  }
  std::uint32_t row = 1 + d_;
  for (std::uint32_t i = 0; i < d_ && quadratic_; ++i) {
    for (std::uint32_t j = i; j < d_; ++j, ++row) {
      double* to = t + row * terms_;
      to[0] = b[i] * b[j];
      for (std::uint32_t k = 0; k < d_; ++k) to[1 + k] = b[i] * a[j * d_ + k] + b[j] * a[i * d_ + k];
      std::uint32_t column = 1 + d_;
      for (std::uint32_t k = 0; k < d_; ++k)
        for (std::uint32_t l = k; l < d_; ++l, ++column)
          to[column] = a[i * d_ + k] * a[j * d_ + l] + (k == l ? 0.0 : a[i * d_ + l] * a[j * d_ + k]);
    }
  }
  double full[kMaxTerms * kMaxTerms], half[kMaxTerms * kMaxTerms];
  for (std::uint32_t state = 0; state < nx_; ++state) {
    double* gram = gram_ + state * triangle_;
    for (std::uint32_t r = 0, i = 0; r < terms_; ++r)
      for (std::uint32_t c = r; c < terms_; ++c, ++i) full[r * terms_ + c] = full[c * terms_ + r] = gram[i];
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
        gram[i] = sum;
      }
  }
  for (std::uint32_t j = 0; j < projections_; ++j) {
    double* tilt = tilt_ + j * terms_;
    double moved[kMaxTerms] = {};
    for (std::uint32_t c = 0; c < terms_; ++c)
      for (std::uint32_t k = 0; k < terms_; ++k) moved[c] += t[k * terms_ + c] * tilt[k];
    std::memcpy(tilt, moved, sizeof(double) * terms_);
  }
}

bool ResidualSummary::add(const float* residual, const float* weight, const float* basis) {
  for (std::uint32_t r = 0; r < nx_; ++r)
    for (std::uint32_t k = 0; k < points_ && weight[r] > 0.0f; ++k)
      if (!std::isfinite(residual[r * points_ + k])) return false;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    if (!(weight[r] > 0.0f)) continue;
    double c[kMaxTerms], e[kMaxPoints];
    for (std::uint32_t k = 0; k < points_; ++k) e[k] = static_cast<double>(residual[r * points_ + k]);
    for (std::uint32_t i = 0; i < terms_; ++i) {
      const double* row = pseudo_inverse_ + i * points_;
      double part[4] = {};
      for (std::uint32_t k = 0; k < points_; k += 4)
        for (std::uint32_t l = 0; l < 4; ++l) part[l] += row[k + l] * e[k + l];
      c[i] = (part[0] + part[1]) + (part[2] + part[3]);
    }
    const double w = static_cast<double>(weight[r]);
    double* gram = gram_ + r * triangle_;
    for (std::uint32_t i = 0; i < terms_; ++i)
      for (std::uint32_t j = i; j < terms_; ++j) *gram++ += w * c[i] * c[j];
    for (std::uint32_t joint = 0; joint < joints_; ++joint) {
      if (velocity_[joint] != r) continue;
      const std::uint32_t regressors = projections_ / joints_;
      for (std::uint32_t b = 0; b < regressors; ++b) {
        const std::uint32_t at = joint * regressors + b;
        for (std::uint32_t i = 0; i < terms_; ++i) tilt_[at * terms_ + i] += w * static_cast<double>(basis[at]) * c[i];
      }
    }
  }
  empty_ = false;
  return true;
}

void ResidualSummary::add_sums(std::uint32_t lanes, const double* coordinate, double factor, double* sums,
                               std::uint32_t stride) const {
  if (empty_) return;
  PolynomialJob job;
  job.d = d_;
  job.nx = nx_;
  job.projections = projections_;
  job.terms = terms_;
  job.quadratic = quadratic_;
  job.lanes = lanes;
  job.centre = centre_;
  job.inverse_root = inverse_root_;
  job.gram = gram_;
  job.tilt = tilt_;
  job.factor = factor;
  job.coordinate = coordinate;
  job.sums = sums;
  job.stride = stride;
  transition_table().polynomial(job);
}

}  // namespace tiller
