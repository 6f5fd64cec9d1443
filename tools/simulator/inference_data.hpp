#pragma once

#include <string>
#include <vector>

#include "tools/simulator/pieces.hpp"
#include "tools/simulator/simulator_file.hpp"

namespace tiller::tools {

/// What the laboratory `infer` learns from, as JSON (python/tiller/labs/problem.py reads it): how the simulator is
/// started, names, the priors, sensors' noise and seed of `robot`, and the logs cut to pieces. All digits of every
/// number are kept.
std::string inference_data_json(const SimulatorFile& file, const RobotFile& robot, const Words& logs,
                                const std::vector<Piece>& pieces);

}  // namespace tiller::tools
