#pragma once

#include "tools/links/link.hpp"
#include "tools/run/run_result.hpp"

namespace tiller::tools {

/// link -> tiller_tick -> link, until the time is over, Ctrl-C, or SAFE. Shows progress on stdout; what goes
/// wrong is told on stderr. Leaves the robot with its safe command, whatever the reason of the end.
RunResult run_robot(const RobotFile& robot, Link& link, const RunOptions& options);

}  // namespace tiller::tools
