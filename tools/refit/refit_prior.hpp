#pragma once

#include <string>

#include "tools/identify/method.hpp"
#include "tools/run/episodes.hpp"

namespace tiller::tools {

/// A method of methods.def between the episodes of a run.
struct RefitOptions {
  std::string method = "simopt";  ///< simopt, trajectory_simopt or reps
  MethodOptions how;
};

/// The methods that refit a prior: all of methods.def that take the logs of an episode and the prior before it, and
/// ask for no sensor at every state.
Words refit_methods();

/// Refits the episode's prior to the episode's log alone, as SimOpt does between real rollouts (Chebotar et al., ICRA
/// 2019, algorithm 1). simopt, trajectory_simopt: the new prior is the method's Gaussian, one component. reps: a
/// mixture fitted to 512 of the weighted draws, resampled (fit_mixture), as `tiller identify -o` writes it.
///
/// It reads the same rows as `tiller identify --method` does of a record of the episode, and gives the same bits for
/// the same seed. Cost: options.how.simulations times the transitions of the log.
RefitPrior make_refit(const RefitOptions& options);

/// False with a sentence in `error` where the method cannot work with this robot, whatever an episode brings: to know
/// before anything moves.
bool check_refit(const RefitOptions& options, const RobotFile& robot, std::string& error);

}  // namespace tiller::tools
