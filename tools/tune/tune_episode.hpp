#pragma once

#include <csignal>
#include <cstdint>
#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools::tune {

/// The end of an episode.
struct Outcome {
  double score = 0;   ///< the return: minus the mean stage cost; -infinity: the state was not finite
  bool safe = false;  ///< the controller latched SAFE
  std::string error;  ///< the episode could not begin; empty: it did
};

/// `robot` with these seeds, as `tiller run --sim --seed SEED` has it: lockstep, plans that no clock ends.
RobotFile seeded(const RobotFile& robot, std::uint64_t seed);

/// An episode of `seconds` on the plant of [sim], by the stage cost of `judge` (the settings before tuning: a task that
/// is made easier is no better controller) at the true states. SAFE does not end it: the safe command's cost counts.
/// Same robot, same bits. Ends early once `stop` is set.
Outcome play(const RobotFile& robot, const tiller_config_t& judge, double seconds,
             const volatile std::sig_atomic_t& stop);

}  // namespace tiller::tools::tune
