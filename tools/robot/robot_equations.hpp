#pragma once

// Whether the model's equations have finite values where the controller begins, and near it.

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The value below which a share of the prior lies: 0.5 is its median.
double parameter_at(const tiller_prior_t& prior, double share);
/// An error where the model has no finite motion at the start.
void check_start(FileErrors& errors, const toml::table& root, const RobotFile& robot);
/// The same at random points within [start] sd, the limits of [measurement] and [limits].
void hint_at_equations(FileErrors& hints, const toml::table& root, const RobotFile& robot);

}  // namespace tiller::tools
