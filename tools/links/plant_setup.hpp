#pragma once

#include <memory>
#include <string>
#include <vector>

#include "sim/plant/plant.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The simulated plant of a robot file, and what is true in it.
struct SimPlant {
  std::unique_ptr<sim::Plant> plant;
  std::vector<double> true_params;         // (param_count) NaN: the plant has nothing that answers to it
  std::vector<std::size_t> measured_from;  // (ny) index of the plant's channel for each measurement
  std::vector<int> state_from;             // (nx) index of the plant's state; -1: it has none of that name
};

/// Builds the plant of [sim]. With `draw`, the parameters and effects that have a prior in the robot file are
/// drawn from it by the seed; what [sim] itself gives goes before. Null with a message in `error`.
std::unique_ptr<SimPlant> make_sim_plant(const RobotFile& robot, std::string& error);

/// The plant's truth in the place of what [sim] says of it, params (np) in the order of the robot's: a number stands
/// for [sim]'s, and NaN leaves that. An effect is set where its first parameter is a number. Nothing is drawn then, and
/// where there is no [sim] the plant is the model.
void set_true_params(RobotFile& robot, const double* params);

/// One draw from a prior (the value itself where it is fixed); u in (0, 1) comes from `uniform`.
double draw_from_prior(const tiller_prior_t& prior, double (*uniform)(void*), void* context);

}  // namespace tiller::tools
