#pragma once

#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The commands that build an exported configuration into a program: lines of a shell, each indented by `indent`. They
/// run in the robot file's folder, where `config_file` and the user's main.o are too, and need tiller installed under
/// PREFIX. A model of the user's own is compiled along, for this machine's instruction set.
std::string build_commands(const RobotFile& robot, const std::string& config_file, const std::string& indent);

}  // namespace tiller::tools
