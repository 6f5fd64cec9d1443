#pragma once

#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The robot file as C99: a constant tiller_config_t and `tiller_config_t <prefix>_config(void)`, which copies it and
/// sets the model. Compiles against tiller.h alone and links against the runtime; the head has the commands, in which
/// the text is in the file `config_file`.
std::string export_c(const RobotFile& robot, const std::string& prefix, const std::string& config_file);

/// What `name` becomes as the start of C identifiers.
std::string c_identifier(const std::string& name);

}  // namespace tiller::tools
