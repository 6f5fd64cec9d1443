#include "tools/imitate/game.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace tiller::tools::imitate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd mixture(const Equilibrium& e) {
  VectorXd mean = VectorXd::Zero(e.policies[0].size());
  for (std::size_t j = 0; j < e.policies.size(); ++j) mean += e.share[j] * e.policies[j];
  return mean;
}

/// Shares of the policies and weights of the box at the equilibrium of the game so far: rows are
/// sum_j share_j mu_j - above + below = demonstrated, and shares that sum to one; cost half of above and below.
bool solve_box(const Game& game, Equilibrium& e) {
  const Index d = game.demonstrated.size(), m = static_cast<Index>(e.policies.size());
  MatrixXd a = MatrixXd::Zero(d + 1, m + 2 * d);
  VectorXd b(d + 1), c = VectorXd::Constant(m + 2 * d, 0.5), x, dual;
  for (Index j = 0; j < m; ++j) {
    a.col(j) << e.policies[static_cast<std::size_t>(j)], 1;
    c(j) = 0;
  }
  a.block(0, m, d, d) = -MatrixXd::Identity(d, d);
  a.block(0, m + d, d, d).setIdentity();
  b << game.demonstrated, 1;
  std::vector<int> basis = {0};  // the first policy alone, and what is over or missing
  for (Index i = 0; i < d; ++i)
    basis.push_back(static_cast<int>(e.policies[0](i) > game.demonstrated(i) ? m + i : m + d + i));
  if (!linear_program(a, b, c, basis, x, dual)) return false;
  for (Index j = 0; j < m; ++j) e.share[static_cast<std::size_t>(j)] = std::max(0.0, x(j));
  e.value = c.dot(x);
  e.weight = -dual.head(d);
  return true;
}

}  // namespace

bool linear_program(const MatrixXd& a, const VectorXd& b, const VectorXd& c, std::vector<int>& basis, VectorXd& x,
                    VectorXd& dual) {
  constexpr double kSmall = 1e-11;
  for (int pivot = 0; pivot < 100000; ++pivot) {
    MatrixXd columns(a.rows(), a.rows());
    VectorXd price(a.rows());
    for (std::size_t r = 0; r < basis.size(); ++r) {
      columns.col(static_cast<Index>(r)) = a.col(basis[r]);
      price(static_cast<Index>(r)) = c(basis[r]);
    }
    const Eigen::PartialPivLU<MatrixXd> lu(columns);
    const VectorXd at = lu.solve(b);
    dual = lu.transpose().solve(price);
    const VectorXd gain = c - a.transpose() * dual;
    Index enter = 0;
    while (enter < gain.size() && gain(enter) > -kSmall) ++enter;
    if (enter == gain.size()) {
      x = VectorXd::Zero(a.cols());
      for (std::size_t r = 0; r < basis.size(); ++r) x(basis[r]) = at(static_cast<Index>(r));
      return true;
    }
    const VectorXd along = lu.solve(a.col(enter));
    int leave = -1;
    double least = INFINITY;
    for (Index r = 0; r < along.size(); ++r) {
      const double ratio = std::max(0.0, at(r)) / along(r);
      if (!(along(r) > kSmall) || ratio > least + kSmall) continue;
      if (leave < 0 || ratio < least - kSmall ||
          basis[static_cast<std::size_t>(r)] < basis[static_cast<std::size_t>(leave)])
        leave = static_cast<int>(r), least = std::min(least, ratio);
    }
    if (leave < 0) return false;
    basis[static_cast<std::size_t>(leave)] = static_cast<int>(enter);
  }
  return false;
}

Equilibrium multiplicative_weights(const Game& game, const VectorXd& scale, int rounds) {
  const Index d = game.demonstrated.size();
  Equilibrium e;
  VectorXd level = VectorXd::Zero(d), sum = VectorXd::Zero(d);
  e.bound = -INFINITY;
  const double rate = std::sqrt(2 * std::log(static_cast<double>(d) + 1e-9) / std::max(1, rounds));
  for (e.rounds = 0; e.rounds < rounds; ++e.rounds) {
    VectorXd w = (level.array() - level.maxCoeff()).exp();
    w /= w.sum();
    const VectorXd scaled = w.cwiseQuotient(scale);
    e.policies.push_back(game.best(scaled));
    const VectorXd excess = (e.policies.back() - game.demonstrated).cwiseQuotient(scale);
    e.bound = std::max(e.bound, w.dot(excess));
    sum += w;
    level += rate * excess.cwiseMax(-1).cwiseMin(1);
  }
  e.share.assign(e.policies.size(), 1.0 / std::max(1, rounds));
  e.value = (mixture(e) - game.demonstrated).cwiseQuotient(scale).maxCoeff();
  e.weight = (sum / std::max(1, rounds)).cwiseQuotient(scale);
  return e;
}

Equilibrium projection(const Game& game, double tolerance, int rounds) {
  Equilibrium e;
  e.policies.push_back(game.best(VectorXd::Ones(game.demonstrated.size())));
  e.share.push_back(1);
  VectorXd nearest = e.policies[0];
  e.bound = 0;
  for (e.rounds = 1; e.rounds < rounds; ++e.rounds) {
    const VectorXd w = nearest - game.demonstrated;
    e.value = w.norm();
    if (e.value < tolerance) break;
    e.weight = w / e.value;
    const VectorXd mu = game.best(e.weight);
    e.bound = std::max(e.bound, e.weight.dot(mu - game.demonstrated));
    if (e.value - e.bound < tolerance) break;
    const VectorXd step = mu - nearest;
    const double along = std::clamp(-step.dot(w) / std::max(step.squaredNorm(), 1e-300), 0.0, 1.0);
    for (double& share : e.share) share *= 1 - along;
    e.policies.push_back(mu);
    e.share.push_back(along);
    nearest += along * step;
  }
  e.value = (nearest - game.demonstrated).norm();
  return e;
}

Equilibrium total_variation(const Game& game, double tolerance, int rounds) {
  Equilibrium e;
  e.policies.push_back(game.best(VectorXd::Zero(game.demonstrated.size())));
  e.share.push_back(1);
  e.bound = -INFINITY;
  for (e.rounds = 1; e.rounds <= rounds; ++e.rounds) {
    if (!solve_box(game, e)) break;
    const VectorXd mu = game.best(e.weight);
    e.bound = std::max(e.bound, e.weight.dot(mu - game.demonstrated));
    if (e.value - e.bound <= tolerance) break;
    e.policies.push_back(mu);
    e.share.push_back(0);
  }
  return e;
}

}  // namespace tiller::tools::imitate
