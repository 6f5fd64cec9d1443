#pragma once

#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What a valid robot file, read from `text`, says and hardly means, a line each: file, line, key, value, the likely
/// meaning and what to write for it. "": nothing.
std::string robot_hints(const RobotFile& robot, const std::string& text);

}  // namespace tiller::tools
