#pragma once

#include <vector>

#include "core/rng.hpp"
#include "tiller/tiller.h"

namespace tiller::tools::distill {

/// Mean and deviation of every parameter's prior (np each), by 512 draws; a fixed one has no deviation.
struct PriorMoments {
  std::vector<double> mean, sd;
};
PriorMoments prior_moments(const tiller_config_t& config);

/// One episode's hidden parameters, drawn from the prior, and what a posterior holds of them as it learns.
///
/// A parameter's posterior is that of a Gaussian with prior N(m0, s0^2) whose data are worth w/(1 - w) of the prior:
///
///     deviation  s0 sqrt(1 - w)          mean  (1 - w) m0 + w truth + s0 sqrt(w (1 - w)) z,   z ~ N(0, 1) once
///
/// with w = t / (t + tau), and tau of each parameter log-uniform in [1e-3, 30] s: some are known at once, others never.
/// Correlations between parameters are left out: a policy that reads moments does not see them.
class BeliefStory {
 public:
  BeliefStory(const tiller_config_t& config, const PriorMoments& prior, Rng& rng);

  /// Moments after so long.
  void tell(double time_s);
  /// Fills hypotheses (count x np, a row each) with draws from the present moments, within the priors' bounds; the
  /// draws of a hypothesis lie at the same quantiles all along, as a particle does.
  void draw(std::uint32_t count, std::vector<double>& hypotheses) const;

  const std::vector<double>& truth() const { return truth_; }  // (np)
  const std::vector<double>& mean() const { return mean_; }    // (np)
  const std::vector<double>& sd() const { return sd_; }        // (np)

 private:
  const tiller_config_t& config_;
  const PriorMoments& prior_;
  std::uint64_t particles_seed_;
  std::vector<double> truth_, off_, tau_s_, mean_, sd_;
};

}  // namespace tiller::tools::distill
