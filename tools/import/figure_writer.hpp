#pragma once

#include <string>

#include "tools/import/model_writer.hpp"

namespace tiller::tools {

/// [figure] for the robot file of an imported model: a link for each of the description's that moves, carries one that
/// does, or ends the robot; with its joint as the description has it and the states that `names` gives them. `told`:
/// points of interest that have a link too.
std::string write_figure(const Description& robot, const MechanismOptions& options, const Mechanism& mechanism,
                         const ModelNames& names, const std::vector<int>& told);

}  // namespace tiller::tools
