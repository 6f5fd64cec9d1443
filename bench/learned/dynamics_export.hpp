#pragma once

#include <string>

#include "harness/gap_worlds/gap_worlds.hpp"

namespace tiller::bench {

/// A world as one JSON file for learners of another kind (bench/peers/dynamics_peer.py): names, period, sensors, the
/// work runs as measured, the scoring runs with their true states, and what the model without anything learnt comes to
/// there, in sensor deviations. False: `error` names the file.
bool export_world(const World& world, double period_s, double before_sigma, const std::string& path,
                  std::string& error);

}  // namespace tiller::bench
