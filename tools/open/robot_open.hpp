#pragma once

#include <memory>
#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Reads a robot file. Null: `errors` holds everything that is wrong, one line each, with file, line, key,
/// value and remedy. A model file is compiled on the way (see load_model).
std::unique_ptr<RobotFile> read_robot_file(const std::string& path, std::string& errors);

/// The same from text; `path` stands in errors and is where relative model files are looked for.
std::unique_ptr<RobotFile> parse_robot_file(const std::string& text, const std::string& path, std::string& errors);

}  // namespace tiller::tools
