#pragma once

#include <functional>
#include <vector>

#include "tools/imitate/game.hpp"
#include "tools/imitate/maxent.hpp"

namespace tiller::tools::imitate {

struct MatchingOptions {
  int rounds = 40;
  std::uint32_t horizon = 0;  ///< of a demonstrator with a receding horizon; 0: each motion is one plan to its end
};

struct MatchingFit {
  std::vector<double> value;         ///< (learnt) weights, relative to what is kept
  std::vector<double> demonstrated;  ///< (learnt + 1) mean features of the demonstrations; the first is what is kept
  std::vector<double> made;          ///< the same of the mixture of plans
  double excess = 0, bound = 0;      ///< the game's value: the largest relative excess of a feature, and its bound
};

/// Weights at which plans from the demonstrations' starts spend no more of any feature than the demonstrations do:
/// Syed and Schapire's game over the simplex with multiplicative weights, each feature over the demonstrations' mean.
/// A feature that the demonstrations have none of has no say. Cost: `rounds` plans of every demonstration.
MatchingFit fit_matching(const Scene& scene, const std::vector<Motion>& motions, const std::vector<CostTerm>& learnt,
                         const MatchingOptions& options);

}  // namespace tiller::tools::imitate
