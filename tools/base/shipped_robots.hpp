#pragma once

#include <string>

namespace tiller::tools {

/// Folder of the robot files that come with tiller: TILLER_ROBOTS, that of the source tree, or the one installed beside
/// the program.
std::string shipped_robots();

}  // namespace tiller::tools
