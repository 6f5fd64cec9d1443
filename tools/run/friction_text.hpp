#pragma once

#include <string>

#include "tools/base/text.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// "0.150 +- 0.002 N m", a dry friction at a joint beyond the model's (a viscous one: N m s); empty where none is sure.
std::string dry_text(const RobotFile& robot, const tiller_info_t& info, std::uint32_t joint);
std::string viscous_text(const RobotFile& robot, const tiller_info_t& info, std::uint32_t joint);

/// A line of each friction that is sure: "joint slide: dry friction beyond the model, 0.15 +- 0.01 N".
Words friction_lines(const RobotFile& robot, const tiller_info_t& info);

}  // namespace tiller::tools
