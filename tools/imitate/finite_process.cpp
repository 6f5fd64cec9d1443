#include "tools/imitate/finite_process.hpp"

#include <Eigen/LU>

namespace tiller::tools::imitate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The chain under a policy: row s, column s'.
MatrixXd chain(const FiniteProcess& process, const MatrixXd& policy) {
  MatrixXd p = MatrixXd::Zero(process.states(), process.states());
  for (Index a = 0; a < process.actions(); ++a)
    p += policy.col(a).asDiagonal() * process.next[static_cast<std::size_t>(a)];
  return p;
}

}  // namespace

VectorXd FiniteProcess::occupancy(const MatrixXd& policy) const {
  const MatrixXd flow = MatrixXd::Identity(states(), states()) - discount * chain(*this, policy).transpose();
  const VectorXd visits = (1 - discount) * flow.partialPivLu().solve(start);
  VectorXd all(states() * actions());
  for (Index s = 0; s < states(); ++s)
    for (Index a = 0; a < actions(); ++a) all(s * actions() + a) = visits(s) * policy(s, a);
  return all;
}

VectorXd FiniteProcess::best_occupancy(const VectorXd& cost) const {
  MatrixXd policy = MatrixXd::Zero(states(), actions());
  policy.col(0).setOnes();
  for (int round = 0; round < 1000; ++round) {
    VectorXd own(states());
    for (Index s = 0; s < states(); ++s) own(s) = policy.row(s).dot(cost.segment(s * actions(), actions()));
    const MatrixXd left = MatrixXd::Identity(states(), states()) - discount * chain(*this, policy);
    const VectorXd value = left.partialPivLu().solve(own);
    bool changed = false;
    for (Index s = 0; s < states(); ++s) {
      Index now = 0, best = 0;
      policy.row(s).maxCoeff(&now);
      VectorXd q(actions());
      for (Index a = 0; a < actions(); ++a)
        q(a) = cost(s * actions() + a) + discount * next[static_cast<std::size_t>(a)].row(s).dot(value);
      q.minCoeff(&best);
      if (!(q(best) < q(now) - 1e-12)) continue;
      policy.row(s).setZero();
      policy(s, best) = 1;
      changed = true;
    }
    if (!changed) break;
  }
  return occupancy(policy);
}

}  // namespace tiller::tools::imitate
