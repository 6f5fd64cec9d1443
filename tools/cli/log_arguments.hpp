#pragma once

#include <memory>
#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The two words of commands that read a run back: LOG [ROBOT]. Whoever gives the robot file first means the same.
void put_log_first(std::string& log, std::string& robot);

/// The robot file, or the one that the log carries. Null after a complaint; `command` is the command's name.
std::unique_ptr<RobotFile> read_robot_of_log(const std::string& command, const std::string& log,
                                             const std::string& robot);

}  // namespace tiller::tools
