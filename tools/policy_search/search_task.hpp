#pragma once

#include <string>

#include "tools/policy_search/long_term_cost.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools::policy {

struct TaskOptions {
  double period_s = 0.1;  ///< of the policy
  double seconds = 4.0;   ///< of a trial
  double width = 0;       ///< of the saturating cost; 0: the start lies four widths from the target
  bool physics = false;   ///< learn what the robot file's model leaves, else everything
};

/// The task of a robot file: its start, limits and target. The cost saturates over the file's state weights,
///
///     1 - exp(-1/2 sum_i w_i d_i^2 / width^2),   d_i = x_i - target_i, and the chord for an angle
///
/// so that no step costs more than one, and speeds weigh as the file says. False with a sentence in `error` where the
/// file has no such task: no limits, no weights, hidden states, or a start at the target.
bool make_task(const RobotFile& robot, const TaskOptions& options, SearchTask& task, std::string& error);

/// One period of the robot file's model at its priors' centre, by its own integrator and substeps.
PhysicsStep physics_of(const RobotFile& robot, double period_s);

}  // namespace tiller::tools::policy
