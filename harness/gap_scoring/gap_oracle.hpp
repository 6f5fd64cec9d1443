#pragma once

// Result of a fit that is told the hidden effects: the standard that answers are held to.

#include <vector>

#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/gap/pipeline/gap.hpp"

namespace tiller::bench {

struct Oracle {
  double gap = 0;  ///< 1 s rollouts on the hold-out logs, sigma; NaN: the catalogue lacks an effect, or no fit
  std::vector<tools::gap::Estimate> params;
};
Oracle fit_oracle(const tools::RobotFile& robot, const tools::gap::Options& options, const WorldCase& truth);

/// Of the horizons that have windows the one nearest to 1 s; null: there is none.
const tools::gap::HorizonGap* one_second(const std::vector<tools::gap::HorizonGap>& horizons);

}  // namespace tiller::bench
