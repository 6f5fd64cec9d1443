#pragma once

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Where a field of tiller_config_t comes from in a robot file: tiller_config_check names "priors[3]" or
/// "planner.rollouts"; the file's owner knows "effects[1].damping_SI". Section, then keys; never empty.
Words trace_field(const RobotFile& robot, const std::string& field);

}  // namespace tiller::tools
