#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tiller/config.hpp"

namespace tiller_test {

/// The optimum of the lander's linear-quadratic problem with one cone and limits, found apart from the library: the
/// motion is summed up exactly (a force that holds for a period), the gradient comes from the adjoint equations, and
/// projected gradient steps with Nesterov's momentum (FISTA, Beck and Teboulle 2009; restarted where the cost rises, as
/// O'Donoghue and Candes 2015) go on until nothing moves. Several masses share the first `shared` forces and have their
/// own behind them; their costs are averaged.
class ConeReference {
 public:
  ConeReference(const tiller_config_t& config, std::vector<double> start, std::vector<double> masses,
                std::uint32_t horizon)
      : ConeReference(config, std::move(start), std::move(masses), horizon, horizon) {}
  ConeReference(const tiller_config_t& config, std::vector<double> start, std::vector<double> masses,
                std::uint32_t horizon, std::uint32_t shared)
      : c_(config), start_(std::move(start)), masses_(std::move(masses)), n_(horizon), shared_(shared) {}

  /// Forces of the tree: the shared ones, then mass by mass.
  std::size_t forces() const { return shared_ + masses_.size() * (n_ - shared_); }
  std::size_t at(std::size_t mass, std::uint32_t step) const {
    return step < shared_ ? step : shared_ + mass * (n_ - shared_) + step - shared_;
  }

  /// Cost of forces (forces() x 3) as the planners count it.
  double cost(const std::vector<double>& u) const {
    std::vector<double> unused(u.size());
    return evaluate(u, unused, true);
  }

  /// (forces() x 3)
  std::vector<double> solve(int steps = 20000) const {
    const double rate = 1.0 / largest_curvature();
    std::vector<double> u(3 * forces(), 0.0), ahead, gradient(u.size()), next;
    for (std::size_t k = 0; k < forces(); ++k) project(&u[3 * k]);
    ahead = u;
    double momentum = 1.0, best = cost(u);
    for (int i = 0; i < steps; ++i) {
      (void)evaluate(ahead, gradient, true);
      next = ahead;
      for (std::size_t j = 0; j < next.size(); ++j) next[j] -= rate * gradient[j];
      for (std::size_t k = 0; k < forces(); ++k) project(&next[3 * k]);
      const double now = cost(next);
      const double then = 0.5 * (1.0 + std::sqrt(1.0 + 4.0 * momentum * momentum));
      const bool rose = now > best;
      const double carry = rose ? 0.0 : (momentum - 1.0) / then;
      for (std::size_t j = 0; j < next.size(); ++j) ahead[j] = next[j] + carry * (next[j] - u[j]);
      momentum = rose ? 1.0 : then;
      best = now;
      u = next;
    }
    return u;
  }

  /// With rate limits as well, of `step` (3) a period from forces `last` (3): two sets whose common projection has no
  /// closed form, so alternating directions (ADMM, Boyd et al. 2011) over copies of the forces within the cone and of
  /// their changes within the steps. The copies differ from the forces by 1e-7 N or so in the end.
  std::vector<double> solve_with_rates(const double* step, const double* last, int rounds = 60000) const {
    const std::size_t n = 3 * n_;
    std::vector<double> zero(n, 0.0), pull(n), column(n), matrix(n * n);
    (void)evaluate(zero, pull, true);
    const double rho = 0.05 * largest_curvature();
    for (std::size_t j = 0; j < n; ++j) {
      std::vector<double> unit(n, 0.0);
      unit[j] = 1.0;
      (void)evaluate(unit, column, false);
      for (std::size_t i = 0; i < n; ++i) matrix[i * n + j] = column[i] + (i == j ? 2.0 * rho : 0.0);
      if (j + 3 < n) matrix[j * n + j] += rho;  // D'D of the changes: 2 on the diagonal, 1 at the end, -1 beside it
      if (j + 3 < n) matrix[(j + 3) * n + j] -= rho, matrix[j * n + j + 3] -= rho;
    }
    for (std::size_t j = 0; j < n; ++j)  // Cholesky in the lower triangle
      for (std::size_t i = j; i < n; ++i) {
        double sum = matrix[i * n + j];
        for (std::size_t k = 0; k < j; ++k) sum -= matrix[i * n + k] * matrix[j * n + k];
        matrix[i * n + j] = i == j ? std::sqrt(sum) : sum / matrix[j * n + j];
      }
    std::vector<double> u(n, 0.0), in_cone(n, 0.0), change(n, 0.0), y(n, 0.0), w(n, 0.0);
    const auto before = [&](const std::vector<double>& v, std::size_t i) { return i < 3 ? last[i] : v[i - 3]; };
    for (int round = 0; round < rounds; ++round) {
      for (std::size_t i = 0; i < n; ++i) {
        u[i] = -pull[i] + rho * (in_cone[i] - y[i]) + rho * (change[i] - w[i] + (i < 3 ? last[i] : 0.0));
        if (i + 3 < n) u[i] -= rho * (change[i + 3] - w[i + 3]);
      }
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < i; ++k) u[i] -= matrix[i * n + k] * u[k];
        u[i] /= matrix[i * n + i];
      }
      for (std::size_t i = n; i-- > 0;) {
        for (std::size_t k = i + 1; k < n; ++k) u[i] -= matrix[k * n + i] * u[k];
        u[i] /= matrix[i * n + i];
      }
      for (std::size_t i = 0; i < n; ++i) in_cone[i] = u[i] + y[i];
      for (std::uint32_t k = 0; k < n_; ++k) project(&in_cone[3 * k]);
      for (std::size_t i = 0; i < n; ++i) {
        y[i] += u[i] - in_cone[i];
        const double moved = u[i] - before(u, i);
        change[i] = std::clamp(moved + w[i], -step[i % 3], step[i % 3]);
        w[i] += moved - change[i];
      }
    }
    return in_cone;
  }

  /// The nearest forces within limits and cone. The distance is convex in the axis, so its best value under limits is
  /// the best one, cut to them.
  void project(double* u) const {
    const tiller_input_cone_t& cone = c_.safety.cones[0];
    double norm = 0.0;
    for (std::uint32_t i = 0; i < 3; ++i)
      if ((cone.inputs >> i) & 1u) norm += u[i] * u[i];
    norm = std::sqrt(norm);
    double radius = cone.limit;
    if (cone.slope > 0.0) {
      const std::uint32_t a = cone.axis;
      const double beyond = norm - cone.limit - cone.slope * u[a];
      if (beyond > 0.0) {
        u[a] += cone.slope * beyond / (1.0 + cone.slope * cone.slope);
        u[a] = std::max(u[a], -cone.limit / cone.slope);  // the apex
      }
    }
    for (std::uint32_t i = 0; i < 3; ++i)
      if (((cone.inputs >> i) & 1u) == 0) u[i] = std::clamp(u[i], c_.safety.input_low[i], c_.safety.input_high[i]);
    if (cone.slope > 0.0) radius += cone.slope * u[cone.axis];
    for (std::uint32_t i = 0; i < 3 && norm > radius; ++i)
      if ((cone.inputs >> i) & 1u) u[i] *= radius / norm;
  }

 private:
  /// Cost, and its gradient. `whole`: with start, weight and target; else the quadratic part alone.
  double evaluate(const std::vector<double>& u, std::vector<double>& gradient, bool whole) const {
    const double dt = c_.period_s, share = 1.0 / static_cast<double>(masses_.size());
    std::fill(gradient.begin(), gradient.end(), 0.0);
    double sum = 0.0;
    for (std::size_t j = 0; j < masses_.size(); ++j) {
      const double mass = masses_[j];
      std::vector<double> x(6 * (n_ + 1), 0.0);
      for (int i = 0; whole && i < 6; ++i) x[i] = start_[i];
      for (std::uint32_t k = 0; k < n_; ++k)
        for (int i = 0; i < 3; ++i) {
          const double a = u[3 * at(j, k) + i] / mass - (whole && i == 2 ? 9.81 : 0.0);
          x[6 * (k + 1) + i] = x[6 * k + i] + dt * x[6 * k + 3 + i] + 0.5 * dt * dt * a;
          x[6 * (k + 1) + 3 + i] = x[6 * k + 3 + i] + dt * a;
        }
      double lambda[6] = {};
      for (std::uint32_t k = n_ + 1; k-- > 0;) {
        if (k < n_)
          for (int i = 0; i < 3; ++i) {
            gradient[3 * at(j, k) + i] += (0.5 * dt * dt * lambda[i] + dt * lambda[3 + i]) / mass * share;
            lambda[3 + i] += dt * lambda[i];
          }
        for (int i = 0; i < 6; ++i) {
          const double w = k < n_ ? c_.cost.state_weight[i] : c_.cost.terminal_weight[i];
          const double d = x[6 * k + i] - (whole ? c_.cost.target[i] : 0.0);
          sum += w * d * d * share;
          lambda[i] += 2.0 * w * d;
        }
      }
    }
    for (std::size_t j = 0; j < u.size(); ++j) {
      const double w = c_.cost.input_weight[j % 3] * (j / 3 < shared_ ? 1.0 : share);
      sum += w * u[j] * u[j];
      gradient[j] += 2.0 * w * u[j];
    }
    return sum;
  }

  double largest_curvature() const {
    std::vector<double> v(3 * forces(), 1.0), product(v.size());
    double size = 1.0;
    for (int i = 0; i < 200; ++i) {
      (void)evaluate(v, product, false);
      size = 0.0;
      for (const double p : product) size += p * p;
      size = std::sqrt(size);
      for (std::size_t j = 0; j < v.size(); ++j) v[j] = product[j] / size;
    }
    return 1.01 * size;
  }

  const tiller_config_t& c_;
  std::vector<double> start_, masses_;
  std::uint32_t n_, shared_;
};

}  // namespace tiller_test
