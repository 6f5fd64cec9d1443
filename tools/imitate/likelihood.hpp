#pragma once

#include "tools/imitate/expansion.hpp"

namespace tiller::tools::imitate {

/// Log likelihood of demonstrated inputs under the policy of maximum entropy, with its derivatives.
struct Likelihood {
  double value = 0;    ///< nats
  Vector gradient;     ///< (groups) with respect to the parameter of each weight: of add_likelihood()'s first form its
                       ///< logarithm
  Matrix information;  ///< (groups x groups) expected (Fisher); of inputs at limits the outer product of the slopes
  Eigen::Index inputs = 0;   ///< that counted as drawn from the policy
  Eigen::Index limited = 0;  ///< that counted as beyond a limit
  bool good = true;          ///< false: a curvature was not positive; nothing else is of use then
};

/// How the demonstrator looked ahead.
struct Foresight {
  std::uint32_t horizon = 0;  ///< periods, as a receding horizon does; 0: to the end of the motion
  std::uint32_t every = 1;    ///< with a horizon: inputs between two that are judged, plus one
};

/// Adds a motion's likelihood to `sum`, which has been sized. `weight` (groups) multiplies the features, in nats.
///
/// With cost c the policy of maximum entropy is p(u | x) ~ exp(-Q(x, u)), Q the cost of u now and of the best from then
/// on. To second order around the motion (a Riccati sweep backward, as in iLQR) it is Gaussian: covariance Quu^-1, mean
/// -Quu^-1 Qu from the input that was demonstrated. The product over a motion that follows the model is Levine and
/// Koltun (ICML 2012), equation 5: |H|^1/2 exp(-g' H^-1 g / 2) for gradient g and Hessian H of the cost by all inputs.
///
/// An input at a limit counts as any wish beyond that limit (Tobit 1958): its slope may press against the limit at no
/// loss. Cost: O(steps groups n^3), with a horizon times that.
void add_likelihood(const Expansion& e, const Vector& weight, const Foresight& foresight, Likelihood& sum);
/// The same for weights of any sign: `rate` (groups) is what a unit of its parameter adds to each.
void add_likelihood(const Expansion& e, const Vector& weight, const Vector& rate, const Foresight& foresight,
                    Likelihood& sum);

/// Gains and wishes of that policy along a motion.
struct Policy {
  std::vector<Matrix> gain;       ///< (steps) of (nu x n)
  std::vector<Vector> wish;       ///< (steps) of (nu): mean input minus the demonstrated one
  std::vector<Matrix> precision;  ///< (steps) of (nu x nu)
};
/// Empty lists where a curvature was not positive. `planning`: an input at a limit that would better leave it is free.
Policy policy_along(const Expansion& e, const Vector& weight, bool planning = false);

}  // namespace tiller::tools::imitate
