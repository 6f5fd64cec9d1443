#pragma once

#include <vector>

#include "tools/nets/mlp.hpp"

namespace tiller::tools::nets {

/// A mixture of normals over d numbers; column k is component k.
struct NormalMixture {
  Vector weight;                   ///< (components) sums to one
  Matrix mean;                     ///< (d x components)
  std::vector<Matrix> covariance;  ///< (components) of (d x d)
};

/// The output layer of a mixture-density network (Bishop, NCRG/94/004, 1994) with full covariances: reads the outputs
/// of a network as a mixture of K normals over d numbers.
///
/// Of component k: a logit; a mean m; a lower triangular A with exp(a_ii) on its diagonal, so that the precision A' A
/// is positive definite whatever the network says (Williams, Neural Computation 1996). Outputs: K logits, then K means,
/// then K triangles row by row.
struct MixtureHead {
  int dimension = 1, components = 1;

  int outputs() const { return components * (1 + dimension + dimension * (dimension + 1) / 2); }
  /// Mean over the samples of minus the log density of `target` (d x samples) under `output` (outputs x samples).
  /// `by_output`, if not null, is set to its derivatives. O(samples K d^2).
  double loss(const Matrix& output, const Matrix& target, Matrix* by_output = nullptr) const;
  NormalMixture mixture(const Vector& output) const;
};

/// log density of `at` (d). O(components d^3): for a few points.
double log_density(const NormalMixture& mixture, const Vector& at);

}  // namespace tiller::tools::nets
