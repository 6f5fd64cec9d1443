#pragma once

#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Definitions, as constant C arrays and structs, of the robot's network ("<prefix>_network") and policy
/// ("<prefix>_policy"); "" where it has neither. A policy without the planner that reads it is left out.
std::string networks_text(const RobotFile& robot, const std::string& prefix);

}  // namespace tiller::tools
