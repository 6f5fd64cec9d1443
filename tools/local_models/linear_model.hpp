#pragma once

#include "tools/policy_search/long_term_cost.hpp"

namespace tiller::tools::local {

using policy::Matrix;
using policy::Vector;

/// One period about a point: next = slope [x; u] + offset + noise of covariance `noise`.
struct LinearStep {
  Matrix slope;   ///< (nx x nx + nu)
  Vector offset;  ///< (nx)
  Matrix noise;   ///< (nx x nx)

  Vector next(const Vector& x, const Vector& u) const;
};

/// What is known of a transition [x; u; next] before its data: it is normal with a normal-inverse-Wishart prior. The
/// prior is worth `mean_strength` samples on the mean and `strength` samples on the covariance.
struct TransitionPrior {
  Vector mean;        ///< (2 nx + nu)
  Matrix covariance;  ///< expected; empty: no prior
  double mean_strength = 1.0, strength = 1.0;
};

/// A prior whose mean is a known model: [x; u] about `at` with covariance `spread` (nx + nu), next = model + noise.
TransitionPrior prior_of_physics(const policy::PhysicsStep& physics, int states, const Vector& at, const Matrix& spread,
                                 const Matrix& noise, double strength);

/// Weighted first and second moments of transitions.
struct TransitionMoments {
  double count = 0;
  Vector mean;        ///< (2 nx + nu)
  Matrix covariance;  ///< about the mean

  /// Columns of `samples` (2 nx + nu x N).
  static TransitionMoments of(const Matrix& samples);
};

/// The posterior's mean, conditioned on [x; u] (Levine and Abbeel 2014, section 4; Murphy 2007, equations 200 to 205):
///
///     mu = (m mu_0 + N mean) / (m + N)
///     Sigma = (n_0 Sigma_0 + N S + N m / (N + m) (mean - mu_0)(mean - mu_0)') / (N + n_0)
///
/// `ridge` is added to the diagonal of [x; u]'s covariance. Cost: O((nx + nu)^3).
LinearStep fit_step(const TransitionMoments& data, const TransitionPrior& prior, int states, double ridge);

}  // namespace tiller::tools::local
