#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace tiller_test {

/// b := a^-1 b, a symmetric positive definite.
inline void eliminate(std::vector<std::vector<double>>& a, std::vector<double>& b) {
  const std::size_t n = b.size();
  for (std::size_t p = 0; p < n; ++p)
    for (std::size_t i = p + 1; i < n; ++i) {
      const double f = a[i][p] / a[p][p];
      for (std::size_t j = p; j < n; ++j) a[i][j] -= f * a[p][j];
      b[i] -= f * b[p];
    }
  for (std::size_t p = n; p-- > 0;) {
    for (std::size_t j = p + 1; j < n; ++j) b[p] -= a[p][j] * b[j];
    b[p] /= a[p][p];
  }
}

/// minimise 1/2 z'Hz + g'z subject to rows z <= limits: written out densely, without any structure, to compare with.
struct DenseQp {
  std::vector<std::vector<double>> hessian, rows;
  std::vector<double> gradient, limits;

  explicit DenseQp(std::size_t size) : hessian(size, std::vector<double>(size, 0.0)), gradient(size, 0.0) {}
  std::size_t size() const { return gradient.size(); }
  void at_most(const std::vector<double>& row, double limit) {
    if (!std::isfinite(limit)) return;
    rows.push_back(row);
    limits.push_back(limit);
  }
  void within(double low, const std::vector<double>& row, double high) {
    at_most(row, high);
    std::vector<double> minus = row;
    for (double& v : minus) v = -v;
    at_most(minus, -low);
  }

  /// By a primal-dual interior point method on the whole of the optimality conditions.
  std::vector<double> solve() const {
    const std::size_t n = size(), m = rows.size();
    std::vector<double> z(n, 0.0), s(m), y(m, 1.0), dz(n), ds(m), dy(m), ds_before(m), dy_before(m);
    for (std::size_t i = 0; i < m; ++i) s[i] = std::fmax(1.0, limits[i] - dot(rows[i], z));
    for (int pass = 0; pass < 200; ++pass) {
      double mu = 0.0;
      for (std::size_t i = 0; i < m; ++i) mu += s[i] * y[i] / static_cast<double>(m);
      // where a multiplier is nearly zero, z errs by the root of mu
      if (worst_residual(z, s, y) < 1e-9 && mu < 1e-15) break;
      ds_before.assign(m, 0.0);
      dy_before.assign(m, 0.0);
      step(z, s, y, 0.0, ds_before, dy_before, dz, ds, dy);
      const double affine = longest(s, ds, y, dy);
      double then = 0.0;
      for (std::size_t i = 0; i < m; ++i)
        then += (s[i] + affine * ds[i]) * (y[i] + affine * dy[i]) / static_cast<double>(m);
      const double share = mu > 0.0 ? then / mu : 0.0;
      ds_before = ds;
      dy_before = dy;
      step(z, s, y, share * share * share * mu, ds_before, dy_before, dz, ds, dy);
      const double length = longest(s, ds, y, dy), alpha = length < 1.0 ? 0.99 * length : 1.0;
      for (std::size_t i = 0; i < n; ++i) z[i] += alpha * dz[i];
      for (std::size_t i = 0; i < m; ++i) s[i] += alpha * ds[i], y[i] += alpha * dy[i];
    }
    return z;
  }
  double value(const std::vector<double>& z) const {
    double sum = dot(gradient, z);
    for (std::size_t i = 0; i < size(); ++i) sum += 0.5 * z[i] * dot(hessian[i], z);
    return sum;
  }
  /// How many rows hold with equality, to `tolerance`.
  std::size_t active(const std::vector<double>& z, double tolerance) const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) count += std::fabs(dot(rows[i], z) - limits[i]) < tolerance;
    return count;
  }

 private:
  static double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  }
  double worst_residual(const std::vector<double>& z, const std::vector<double>& s,
                        const std::vector<double>& y) const {
    double worst = 0.0;
    for (std::size_t i = 0; i < rows.size(); ++i)
      worst = std::fmax(worst, std::fabs(dot(rows[i], z) + s[i] - limits[i]));
    for (std::size_t i = 0; i < size(); ++i) {
      double r = gradient[i] + dot(hessian[i], z);
      for (std::size_t k = 0; k < rows.size(); ++k) r += rows[k][i] * y[k];
      worst = std::fmax(worst, std::fabs(r));
    }
    return worst;
  }
  static double longest(const std::vector<double>& s, const std::vector<double>& ds, const std::vector<double>& y,
                        const std::vector<double>& dy) {
    double alpha = 1.0;
    for (std::size_t i = 0; i < s.size(); ++i) {
      if (ds[i] < 0.0) alpha = std::fmin(alpha, -s[i] / ds[i]);
      if (dy[i] < 0.0) alpha = std::fmin(alpha, -y[i] / dy[i]);
    }
    return alpha;
  }
  void step(const std::vector<double>& z, const std::vector<double>& s, const std::vector<double>& y, double centre,
            const std::vector<double>& ds_before, const std::vector<double>& dy_before, std::vector<double>& dz,
            std::vector<double>& ds, std::vector<double>& dy) const {
    const std::size_t n = size(), m = rows.size();
    std::vector<std::vector<double>> k = hessian;
    std::vector<double> rhs(n), rp(m), rc(m);
    for (std::size_t i = 0; i < n; ++i) rhs[i] = -gradient[i] - dot(hessian[i], z);
    for (std::size_t c = 0; c < m; ++c) {
      rp[c] = dot(rows[c], z) + s[c] - limits[c];
      rc[c] = s[c] * y[c] - centre + ds_before[c] * dy_before[c];
      for (std::size_t i = 0; i < n; ++i) {
        rhs[i] -= rows[c][i] * (y[c] + (y[c] * rp[c] - rc[c]) / s[c]);
        for (std::size_t j = 0; j < n; ++j) k[i][j] += rows[c][i] * rows[c][j] * y[c] / s[c];
      }
    }
    eliminate(k, rhs);
    dz = rhs;
    for (std::size_t c = 0; c < m; ++c) {
      const double along = dot(rows[c], dz);
      ds[c] = -rp[c] - along;
      dy[c] = (-rc[c] - y[c] * ds[c]) / s[c];
    }
  }
};

}  // namespace tiller_test
