#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

namespace tiller::tools::imitate {

/// The game of apprenticeship: a demonstrator's feature expectations (d) against those of the policies that a planner
/// makes, both of features to be small.
///
///     min over mixtures of policies   max over w in a set   w' (mu_policy - mu_demonstrator)
///
/// The set: the simplex (Syed and Schapire, NIPS 2007), the Euclidean ball (Abbeel and Ng, ICML 2004), or the box
/// |w_i| <= 1/2, for which the value is half the L1 distance: of occupancies the total variation.
enum class WeightSet { simplex, ball, box };

struct Game {
  Eigen::VectorXd demonstrated;                                        ///< (d)
  std::function<Eigen::VectorXd(const Eigen::VectorXd& weight)> best;  ///< (d) of a policy that makes w' mu least
};

struct Equilibrium {
  double value = 0;                       ///< of the mixture: the largest w' (mu - demonstrated)
  double bound = 0;                       ///< what no mixture is below
  Eigen::VectorXd weight;                 ///< (d) the set's best answer, averaged over rounds where these are averaged
  std::vector<Eigen::VectorXd> policies;  ///< feature expectations
  std::vector<double> share;              ///< of each policy in the mixture, sums to one
  int rounds = 0;
};

/// Multiplicative weights over the simplex: `rounds` calls of the planner, value within O(sqrt(log d / rounds)) of the
/// best; features are taken over the demonstrator's range `scale` (d).
Equilibrium multiplicative_weights(const Game& game, const Eigen::VectorXd& scale, int rounds);

/// Abbeel and Ng's projection: each round the planner answers the weights from the nearest mixture so far to the
/// demonstrator, over the Euclidean ball. Ends where a round gains less than `tolerance`.
Equilibrium projection(const Game& game, double tolerance, int rounds);

/// The box, exactly but for rounding: each side answers the other's best mixture so far until neither gains more than
/// `tolerance`; the mixtures by linear programming. Ends for finitely many deterministic policies.
/// Cost: a linear program of (rounds + 2 d) variables and d + 1 rows a round.
Equilibrium total_variation(const Game& game, double tolerance, int rounds);

/// Least c' x so that A x = b, x >= 0, from the basis `basis` (rows), which is feasible; it and `dual` (rows) are left
/// at the solution. The revised simplex method with Bland's rule. False where the program has no bound.
bool linear_program(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, const Eigen::VectorXd& c,
                    std::vector<int>& basis, Eigen::VectorXd& x, Eigen::VectorXd& dual);

}  // namespace tiller::tools::imitate
