#pragma once

#include <string>

#include "tools/logs/recorded_run.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Why a recorded run held, clipped, went SAFE, missed deadlines or refused measurements, in sentences with the place
/// in the log and the key of the robot file; of a run without trouble, that there was none. Empty, with a sentence in
/// `error`: the log does not tell what the controller did.
std::string explain_run(const RobotFile& robot, const RecordedRun& run, const std::string& path, std::string& error);

}  // namespace tiller::tools
