#pragma once

#include <vector>

namespace tiller::tools {

/// Weights of samples by their costs, as near to the cheapest as a KL divergence of epsilon from equal weights
/// allows (relative entropy policy search: Peters, Muelling, Altun, AAAI 2010):
///
///     min_w sum w_i c_i   so that   sum w_i log(n w_i) <= epsilon      =>   w_i ~ exp(-c_i / eta)
///     eta = argmin g(eta),   g(eta) = eta epsilon + eta log(1/n sum exp(-c_i / eta))          (the dual)
///
/// g is convex with g'(eta) = epsilon - KL(eta), and KL falls from log(n / ties of the cheapest) to 0 as eta rises.
/// A cost that is not finite gets weight zero and does not count in n. Equal costs make equal weights at every eta; the
/// bound is then slack.
struct RepsWeights {
  std::vector<double> weight;  ///< (costs) sums to one
  double temperature = 0;      ///< eta; 0: the bound is slack and the cheapest share all the weight
  double kl = 0;
  bool slack = false;  ///< epsilon is more than the cheapest alone make up
};

/// False where no cost is finite or epsilon is not above zero. Cost: O(200 n).
bool reps_weights(const std::vector<double>& cost, double epsilon, RepsWeights& result);

}  // namespace tiller::tools
