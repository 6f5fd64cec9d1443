#pragma once

#include <cstdint>
#include <string>

#include "tools/run/episodes.hpp"

namespace tiller::tools {

/// Online BayesSim between episodes (Possas et al., IROS 2020, algorithm 1) with a simulator file's black box:
/// parameters from the episode's prior, simulated under the episode's inputs; a density is trained on them; at the
/// episode's log, and corrected for the proposal, it is the next episode's prior. Control has planned over the draws of
/// the one before.
///
/// The simulator's parameters, inputs and measurements are the robot file's. `simulations` in `rounds` an episode: the
/// first round's proposal is the prior itself. The laboratory `infer` (python/tiller/labs) learns, in a process for each
/// episode. Null with a sentence in `error`, also where it cannot be started.
RefitPrior make_simulator_refit(const std::string& path, const RobotFile& robot, std::uint32_t simulations,
                                std::uint32_t rounds, std::string& error);

}  // namespace tiller::tools
