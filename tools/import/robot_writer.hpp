#pragma once

#include <string>

#include "tools/import/described_plant.hpp"
#include "tools/import/model_writer.hpp"

namespace tiller::tools {

/// The robot file for an emitted model: priors from the unknowns, limits from the description, a task that moves every
/// joint, a simulated plant, comments on what to look at. `header` is the model's file name. `plant` with its file relative
/// to the robot file's folder; an empty one: the model itself has to do.
/// `figure`: its section (figure_writer.hpp).
std::string write_robot(const Mechanism& mechanism, const Unknowns& unknowns, const ModelNames& names,
                        const std::string& header, const std::string& payload_frame, const DescribedPlant& plant,
                        const std::string& figure);

}  // namespace tiller::tools
