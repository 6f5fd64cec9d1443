#pragma once

#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Makes room for a calibration in the configuration, which may have no prober yet. False with a sentence in `error`
/// where the robot may not be moved so: no prior to learn, or a joint whose position nobody has bounded.
bool allow_calibration(RobotFile& robot, std::string& error);

/// Periods of calibration.seconds.
std::uint32_t calibration_periods(const RobotFile& robot);

/// tiller_calibrate() in the box of [probe], which is the cost's bounds and the limits where nothing is drawn.
tiller_status_t start_calibration(const RobotFile& robot, std::uint32_t periods, tiller_t* controller);

}  // namespace tiller::tools
