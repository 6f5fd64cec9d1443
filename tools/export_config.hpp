#pragma once

#include <string>

#include "tools/robot_file.hpp"

namespace tiller::tools {

/// The robot file as C99: a constant tiller_config_t and `void <prefix>_config(tiller_config_t*)`, which copies
/// it and sets the model. Compiles against tiller.h alone and links against the runtime.
std::string export_c(const RobotFile& robot, const std::string& prefix);

/// What `name` becomes as the start of C identifiers.
std::string c_identifier(const std::string& name);

}  // namespace tiller::tools
