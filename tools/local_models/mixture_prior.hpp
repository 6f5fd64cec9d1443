#pragma once

#include <cstdint>
#include <vector>

#include "tools/local_models/linear_model.hpp"

namespace tiller::tools::local {

/// Transitions of earlier runs as a mixture of normals, each of them a rough local model.
struct TransitionMixture {
  std::vector<double> share;
  std::vector<Vector> mean;
  std::vector<Matrix> covariance;
};

/// Expectation maximisation from random memberships. `samples` (2 nx + nu x N); at most `components`, fewer where data
/// are few. Deterministic. Cost: O(steps N components d^2).
TransitionMixture fit_mixture(const Matrix& samples, int components, int steps, std::uint64_t seed);

/// The prior at a few samples of one time step: the mixture's moments under their memberships, worth `strength` samples
/// (Levine and Abbeel 2014, appendix A.3).
TransitionPrior prior_of_mixture(const TransitionMixture& mixture, const Matrix& samples, double strength);

}  // namespace tiller::tools::local
