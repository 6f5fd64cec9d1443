#pragma once

#include <string>

#include "tools/import/described_plant.hpp"
#include "tools/import/sensors.hpp"

namespace tiller::tools {

/// Of every robot file that an import writes.
constexpr double kImportPeriod_s = 0.01;

/// What an import adds to the robot file beside what every robot has.
struct TaskExtras {
  double margin_rad = 0.0;  ///< of the joints that turn, before their ends
  Spheres spheres;
  ModelSensors sensors;
  std::string figure;  ///< its section (figure_writer.hpp)
};

/// The robot file for an emitted model: priors from the unknowns, limits from the description, a task that moves every
/// joint, a simulated plant, comments on what to look at. `header` is the model's file name. `plant` with its file
/// relative to the robot file's folder; an empty one: the model itself has to do.
std::string write_robot(const Mechanism& mechanism, const Unknowns& unknowns, const ModelNames& names,
                        const std::string& header, const std::string& payload_frame, const DescribedPlant& plant,
                        const TaskExtras& extras = {});

}  // namespace tiller::tools
