#include "tools/local_models/kl_lqr.hpp"

#include <Eigen/Cholesky>
#include <cmath>

namespace tiller::tools::local {
namespace {

/// -log before(u | x) as a quadratic of [x; u].
QuadraticCost negative_log_density(const LinearLaw& law, Eigen::Index nx) {
  const Eigen::Index nu = law.offset.size();
  Matrix rows(nu, nx + nu);
  rows << -law.gain, Matrix::Identity(nu, nu);
  const Matrix precise = law.noise.ldlt().solve(rows);
  return {rows.transpose() * precise, -precise.transpose() * law.offset};
}

double log_determinant(const Matrix& m) {
  return 2.0 * Eigen::LLT<Matrix>(m).matrixLLT().diagonal().array().log().sum();
}

}  // namespace

Passage pass(const std::vector<LinearStep>& models, const LawSequence& laws, const Vector& start_mean,
             const Matrix& start_covariance) {
  Passage out;
  Vector x = start_mean;
  Matrix s = start_covariance;
  for (std::size_t k = 0; k < models.size(); ++k) {
    const Eigen::Index nx = x.size(), nu = laws[k].offset.size();
    Vector mean(nx + nu);
    mean << x, laws[k].mean(x);
    Matrix covariance(nx + nu, nx + nu);
    covariance << s, s * laws[k].gain.transpose(), laws[k].gain * s,
        laws[k].gain * s * laws[k].gain.transpose() + laws[k].noise;
    out.mean.push_back(mean);
    out.covariance.push_back(covariance);
    x = models[k].slope * mean + models[k].offset;
    s = models[k].slope * covariance * models[k].slope.transpose() + models[k].noise;
    s = 0.5 * (s + s.transpose()).eval();
  }
  out.mean.push_back(x);
  out.covariance.push_back(s);
  return out;
}

double expected_cost(const std::vector<QuadraticCost>& costs, const Passage& passage) {
  double sum = 0;
  for (std::size_t k = 0; k < costs.size(); ++k)
    sum += 0.5 * passage.mean[k].dot(costs[k].hessian * passage.mean[k]) + costs[k].slope.dot(passage.mean[k]) +
           0.5 * costs[k].hessian.cwiseProduct(passage.covariance[k]).sum();
  return sum;
}

double divergence(const LawSequence& now, const LawSequence& before, const Passage& of_now) {
  double sum = 0;
  for (std::size_t k = 0; k < now.size(); ++k) {
    const Eigen::Index nx = now[k].gain.cols(), nu = now[k].offset.size();
    const Matrix gain = now[k].gain - before[k].gain;
    const Vector away = gain * of_now.mean[k].head(nx) + now[k].offset - before[k].offset;
    const Matrix second =
        away * away.transpose() + gain * of_now.covariance[k].topLeftCorner(nx, nx) * gain.transpose();
    sum += 0.5 * (before[k].noise.ldlt().solve(now[k].noise + second).trace() - static_cast<double>(nu) +
                  log_determinant(before[k].noise) - log_determinant(now[k].noise));
  }
  return sum;
}

bool soft_lqr(const std::vector<LinearStep>& models, const std::vector<QuadraticCost>& costs, const LawSequence& before,
              double eta, LawSequence& laws) {
  laws.resize(models.size());
  Matrix value = costs.back().hessian / eta;
  Vector slope = costs.back().slope / eta;
  for (std::size_t k = models.size(); k-- > 0;) {
    const Eigen::Index nx = models[k].offset.size(), nu = models[k].slope.cols() - nx;
    const QuadraticCost old = negative_log_density(before[k], nx);
    const Matrix q = costs[k].hessian / eta + old.hessian + models[k].slope.transpose() * value * models[k].slope;
    const Vector g =
        costs[k].slope / eta + old.slope + models[k].slope.transpose() * (value * models[k].offset + slope);
    const Eigen::LLT<Matrix> curvature(q.bottomRightCorner(nu, nu));
    if (curvature.info() != Eigen::Success || !q.allFinite()) return false;
    laws[k].gain = -curvature.solve(q.bottomLeftCorner(nu, nx));
    laws[k].offset = -curvature.solve(g.tail(nu));
    laws[k].noise = curvature.solve(Matrix::Identity(nu, nu));
    value = q.topLeftCorner(nx, nx) + q.topRightCorner(nx, nu) * laws[k].gain;
    value = 0.5 * (value + value.transpose()).eval();
    slope = g.head(nx) + q.topRightCorner(nx, nu) * laws[k].offset;
  }
  return true;
}

bool kl_lqr(const std::vector<LinearStep>& models, const std::vector<QuadraticCost>& costs, const LawSequence& before,
            const Vector& start_mean, const Matrix& start_covariance, double epsilon, LawSequence& laws, KlStep& step) {
  double low = 1e-6, high = 1e12;
  bool found = false;
  for (int i = 0; i < 60 && high / low > 1.02; ++i) {
    const double eta = std::sqrt(low * high);
    LawSequence trial;
    const bool solved = soft_lqr(models, costs, before, eta, trial);
    const Passage passage = solved ? pass(models, trial, start_mean, start_covariance) : Passage();
    const double kl = solved ? divergence(trial, before, passage) : HUGE_VAL;
    if (!(kl <= epsilon)) {
      low = eta;
      continue;
    }
    high = eta;
    laws = trial;
    step = {eta, kl, expected_cost(costs, passage)};
    found = true;
  }
  return found;
}

}  // namespace tiller::tools::local
