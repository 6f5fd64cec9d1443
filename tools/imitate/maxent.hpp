#pragma once

#include <string>
#include <vector>

#include "tools/imitate/cost_parameters.hpp"
#include "tools/imitate/likelihood.hpp"

namespace tiller::tools::imitate {

struct MaxentOptions {
  Foresight foresight;
  double prior_sd = 5;   ///< of a learnt weight's logarithm around the robot file's, and of a target in its units
  int iterations = 100;  ///< of Fisher scoring, at most
};

/// What the demonstrations say of one weight.
struct LearntWeight {
  CostTerm term;
  double value = 0;          ///< relative to what is kept
  double low = 0, high = 0;  ///< 90 % interval, by the curvature of the logarithm of the posterior
  double log_sd = 0;         ///< standard deviation of its logarithm
  bool varies = true;        ///< false: its feature has no slope anywhere along the demonstrations
  bool identified = true;    ///< false: log_sd is above 1, the interval wider than a factor of 5 either way
};

/// What they say of a target.
struct LearntTarget {
  CostTarget target;
  double value = 0;          ///< SI
  double low = 0, high = 0;  ///< 90 % interval
  bool identified = true;    ///< false: its deviation is above the target's unit
};

struct MaxentFit {
  std::vector<LearntWeight> weights;  ///< in the order of the terms
  std::vector<LearntTarget> targets;  ///< in the order of the targets
  double nats = 0;                    ///< what one unit of the kept cost is in nats: the inverse temperature
  double log_likelihood = 0;          ///< nats
  double before = 0;                  ///< that of the robot file's weights at their own best scale
  Eigen::Index inputs = 0, limited = 0;
  int iterations = 0;
  bool converged = false;
  /// Pairs that the demonstrations cannot tell apart: correlation beyond 0.98 of their logarithms.
  std::vector<std::pair<std::size_t, std::size_t>> alike;
};

/// Weights of `learnt` by maximum likelihood of the demonstrated inputs, with a wide Gaussian around the robot file's
/// logarithm: what the demonstrations say nothing of stays there. The scale is that of the terms that are kept, one of
/// them an input's. Fisher scoring with a Levenberg damping; the scale of all is started at its best.
/// False with a sentence in `error`. O(iterations) likelihoods.
bool fit_maxent(const std::vector<Expansion>& motions, const std::vector<CostTerm>& learnt,
                const MaxentOptions& options, MaxentFit& fit, std::string& error);
/// With targets of states: the motions are expanded with them.
bool fit_maxent(const std::vector<Expansion>& motions, const std::vector<CostTerm>& learnt,
                const std::vector<CostTarget>& targets, const MaxentOptions& options, MaxentFit& fit,
                std::string& error);

}  // namespace tiller::tools::imitate
