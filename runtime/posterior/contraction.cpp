#include "posterior/contraction.hpp"

#include <cmath>

#include "posterior/prior.hpp"

namespace tiller {

namespace {

constexpr int kSweeps = 30;  // convergence is quadratic: five to seven are usual

/// Lower Cholesky factor of a, in its place; false where a is not positive definite.
bool factor(std::uint32_t d, double* a) {
  for (std::uint32_t r = 0; r < d; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = a[r * d + c];
      for (std::uint32_t k = 0; k < c; ++k) sum -= a[r * d + k] * a[c * d + k];
      if (r != c) {
        a[r * d + c] = sum / a[c * d + c];
      } else if (sum > 0.0 && std::isfinite(sum)) {
        a[r * d + r] = std::sqrt(sum);
      } else {
        return false;
      }
    }
  }
  return true;
}

/// x = L^-1 x, in rows of stride `stride`
void solve_lower(std::uint32_t d, const double* root, double* x, std::uint32_t stride) {
  for (std::uint32_t r = 0; r < d; ++r) {
    for (std::uint32_t k = 0; k < r; ++k) x[r * stride] -= root[r * d + k] * x[k * stride];
    x[r * stride] /= root[r * d + r];
  }
}

/// One rotation in the plane (p, q) that brings a_pq to zero.
void rotate(std::uint32_t d, std::uint32_t p, std::uint32_t q, double* a, double* v) {
  const double off = a[p * d + q];
  if (off == 0.0) return;
  const double theta = (a[q * d + q] - a[p * d + p]) / (2.0 * off);
  const double t = std::copysign(1.0, theta) / (std::fabs(theta) + std::sqrt(theta * theta + 1.0));
  const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
  const auto turn = [c, s](double& x, double& y) {
    const double x_before = x;
    x = c * x_before - s * y;
    y = s * x_before + c * y;
  };
  for (std::uint32_t k = 0; k < d; ++k) turn(a[k * d + p], a[k * d + q]);
  for (std::uint32_t k = 0; k < d; ++k) turn(a[p * d + k], a[q * d + k]);
  for (std::uint32_t k = 0; k < d; ++k) turn(v[k * d + p], v[k * d + q]);
}

/// Calls visit(coordinates (d), weight) for every particle.
template <class Visit>
void for_each_particle(const tiller_config_t& config, const Posterior& posterior, const Visit& visit) {
  double params[TILLER_MAX_PARAMS] = {}, v[TILLER_MAX_PARAMS] = {}, weight = 0.0;
  for (std::uint32_t k = 0; k < posterior.size(); ++k) {
    posterior.particle(k, params, nullptr, &weight);
    std::uint32_t j = 0;
    for (std::uint32_t i = 0; i < config.param_count; ++i)
      if (config.priors[i].kind != tiller_prior_fixed) v[j++] = to_coordinate(config.priors[i], params[i]);
    if (weight > 0.0) visit(v, weight);
  }
}

/// Weighted covariance (d x d) of the particles' coordinates.
void particle_covariance(const tiller_config_t& config, const Posterior& posterior, std::uint32_t d,
                         double* covariance) {
  double mean[TILLER_MAX_PARAMS] = {};
  for_each_particle(config, posterior, [&](const double* v, double weight) {
    for (std::uint32_t j = 0; j < d; ++j) mean[j] += weight * v[j];
  });
  for (std::uint32_t i = 0; i < d * d; ++i) covariance[i] = 0.0;
  for_each_particle(config, posterior, [&](const double* v, double weight) {
    for (std::uint32_t i = 0; i < d; ++i)
      for (std::uint32_t j = 0; j < d; ++j)
        // NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign): all d * d were set to zero
        covariance[i * d + j] += weight * (v[i] - mean[i]) * (v[j] - mean[j]);
  });
}

}  // namespace

void jacobi_eigen(std::uint32_t d, double* a, double* v) {
  for (std::uint32_t i = 0; i < d * d; ++i) v[i] = i % (d + 1) == 0 ? 1.0 : 0.0;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    double off = 0.0, diagonal = 0.0;
    for (std::uint32_t r = 0; r < d; ++r)
      for (std::uint32_t c = 0; c < d; ++c) (r == c ? diagonal : off) += a[r * d + c] * a[r * d + c];
    if (!(off > 1e-30 * diagonal)) return;
    for (std::uint32_t p = 0; p + 1 < d; ++p)
      for (std::uint32_t q = p + 1; q < d; ++q) rotate(d, p, q, a, v);
  }
}

bool contract(std::uint32_t d, const double* posterior, const double* prior, Contraction& to) {
  constexpr std::uint32_t most = TILLER_MAX_PARAMS * TILLER_MAX_PARAMS;
  double root[most] = {}, white[most] = {}, v[most] = {};
  to = {};
  to.d = d;
  for (std::uint32_t i = 0; i < d * d; ++i) {
    if (!std::isfinite(posterior[i])) return false;
    root[i] = prior[i];
    white[i] = posterior[i];
  }
  if (!factor(d, root)) return false;
  // L^-1 C L^-T: columns, then rows
  for (std::uint32_t c = 0; c < d; ++c) solve_lower(d, root, white + c, d);
  for (std::uint32_t r = 0; r < d; ++r) solve_lower(d, root, white + r * d, 1);
  jacobi_eigen(d, white, v);

  bool taken[TILLER_MAX_PARAMS] = {};
  for (std::uint32_t i = 0; i < d; ++i) {
    std::uint32_t best = d;
    for (std::uint32_t j = 0; j < d; ++j)
      if (!taken[j] && (best == d || white[j * d + j] > white[best * d + best])) best = j;
    taken[best] = true;
    to.variance_ratio[i] = std::fmax(0.0, white[best * d + best]);
    // the direction in which the coordinates vary: L z, each in units of its prior's deviation
    double length = 0.0, largest = 0.0;
    double* row = to.direction + i * d;
    for (std::uint32_t r = 0; r < d; ++r) {
      for (std::uint32_t k = 0; k <= r; ++k) row[r] += root[r * d + k] * v[k * d + best];
      row[r] /= std::sqrt(prior[r * d + r]);
      length += row[r] * row[r];
      if (std::fabs(row[r]) > std::fabs(largest)) largest = row[r];
    }
    for (std::uint32_t r = 0; r < d; ++r) row[r] /= std::copysign(std::sqrt(length), largest);
  }
  return true;
}

bool contract(const tiller_config_t& config, const Posterior& posterior, Contraction& to) {
  double covariance[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS], prior[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS];
  const PriorDistribution law(config);
  particle_covariance(config, posterior, law.dimension(), covariance);
  law.covariance(prior);
  return contract(law.dimension(), covariance, prior, to);
}

}  // namespace tiller
