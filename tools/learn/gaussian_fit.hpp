#pragma once

#include <cstdint>
#include <vector>

#include "tools/learn/dynamics_data.hpp"

namespace tiller::tools::learn {

struct GaussianOptions {
  int inducing = 48, waves = 64, members = 8;
  int hyper_samples = 300;  ///< of the data, for the lengths
  int hyper_steps = 60;
  std::uint64_t seed = 1;
};

/// Draws from the posterior of a sparse Gaussian process over each joint's force.
struct GaussianFit {
  Eigen::VectorXd length;         ///< (inputs) of the squared exponential, standardised, shared by the outputs
  Eigen::VectorXd signal, noise;  ///< (nf) standard deviations, standardised
  double log_evidence = 0;        ///< of the samples that the lengths were fitted to, all outputs
  std::vector<float> weights;     ///< tiller_network_t's layout, kind gaussian, on plain inputs and outputs
};

/// Lengths, signal and noise by the marginal likelihood of a part of the data (Rasmussen and Williams 2006, section
/// 5.4); inducing points as far from each other as the data go; their posterior as of a subset of regressors (section
/// 8.3.1), and `members` functions drawn from it by pathwise conditioning (Wilson et al. 2020): a draw from the prior,
/// by waves, plus the kernel's update at the inducing points. The first member is the mean itself. Cost: hyper_steps x
/// hyper_samples^3, and samples x inducing^2.
GaussianFit fit_gaussian(const DynamicsData& data, const GaussianOptions& options);

}  // namespace tiller::tools::learn
