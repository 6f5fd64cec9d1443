#pragma once

#include <string>
#include <vector>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A goal that takes the place of the one before, from `time_s` after the first measurement on.
struct Goal {
  double time_s = 0;
  std::vector<double> states;   ///< (nx); empty: these goals are not about states
  std::vector<double> outputs;  ///< (ny); empty: nor about outputs
};

/// The robot file's own targets, of states and of outputs.
Goal goal_of(const RobotFile& robot);

/// Reads a CSV of goals: `time_s`, and states and outputs by their names, of a frame also <frame>_roll_rad,
/// <frame>_pitch_rad and <frame>_yaw_rad in the place of its nine. What has no column, or an empty cell, stays as it
/// was. False with every problem in `errors`, "file:line: what: problem; remedy".
bool read_goals(const std::string& path, const RobotFile& robot, std::vector<Goal>& goals, Words& errors);

}  // namespace tiller::tools
