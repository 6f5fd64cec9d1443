#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/gap/residual/fallback.hpp"

namespace tiller::tools::gap {

/// A robot file with the unnamed effect, and what belongs to it.
struct ResidualOffer {
  ResidualFit fit;            ///< of the joint with the largest evidence
  std::string text;           ///< of the robot file: the old one with [[effects]] residual appended and [noise] raised
  StoredPosterior posterior;  ///< to be written beside it, for tiller run --posterior
};

/// A robot file's text with process noise (nx) of at least `process_sd`: the random force that a fit leaves over, as
/// noise of the states that it pushes.
std::string with_process_sd(std::string text, const RobotFile& robot, const double* process_sd);

/// Where a residual is looked for. A fit at one joint of an arm of six takes minutes.
struct ResidualSearch {
  std::vector<std::uint32_t> joints;                ///< in this order; empty: all
  const volatile int* stop = nullptr;               ///< where it is not zero, no further joint is tried
  std::function<void(std::uint32_t joint)> begins;  ///< before each joint; may be empty
};

/// For the verdicts "unnamed" and "partly explained": fits the residual at every joint of `search` that has a position,
/// takes the one with the largest evidence and appends it to `text`, a robot file as it stands (with the effects that
/// were found, if any). The result is read back before it is given out. False with a sentence in `error`; also where
/// the evidence is below `least_nats` over the model without it, or rollouts of one second on these logs are no better
/// with it.
bool offer_residual(const std::string& text, const std::string& path, const std::vector<Grid>& grids, double least_nats,
                    ResidualOffer& offer, std::string& error, const ResidualSearch& search = {});

}  // namespace tiller::tools::gap
