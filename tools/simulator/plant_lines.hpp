#pragma once

#include <iosfwd>
#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The ODE plant of a robot file's [sim] as a simulator in lines (docs/guide/simulator.md): reads requests from `in`
/// until it ends, answers on `out`. A request's parameters are the robot file's, in its order; the model's must be
/// parameters of the plant. A request's start sets the measured states, the rest is at [start]. Sensors show no noise,
/// and whole quantisation and latency. A request that the plant cannot take is answered by an error. False with a
/// sentence in `error` where the greeting is not of this robot.
bool serve_plant_lines(const RobotFile& robot, std::istream& in, std::ostream& out, std::string& error);

}  // namespace tiller::tools
