#pragma once

#include <Eigen/Core>
#include <vector>

namespace tiller::tools::imitate {

/// A Markov decision process of few states and actions, discounted.
struct FiniteProcess {
  std::vector<Eigen::MatrixXd> next;  ///< (actions) of (states x states): row s, column s' the probability of s'
  Eigen::VectorXd start;              ///< (states) probabilities
  double discount = 0.9;              ///< in [0, 1)

  Eigen::Index states() const { return start.size(); }
  Eigen::Index actions() const { return static_cast<Eigen::Index>(next.size()); }

  /// Discounted occupancy (states * actions, entry s * actions + a; sums to one) of a policy (states x actions, rows
  /// sum to one): (1 - discount) sum over t of discount^t times the probability. A linear solve, O(states^3).
  Eigen::VectorXd occupancy(const Eigen::MatrixXd& policy) const;
  /// That of a deterministic policy of least cost (states * actions), by policy iteration from the first actions on:
  /// exact, and the same for the same cost.
  Eigen::VectorXd best_occupancy(const Eigen::VectorXd& cost) const;
};

}  // namespace tiller::tools::imitate
