#pragma once

#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

/// Finds the gap between the robot file's model and the logs. Never throws; data that cannot be used give
/// Verdict::unfit with reasons. Deterministic. One core.
Result find_gap(const RobotFile& robot, const Options& options);

}  // namespace tiller::tools::gap
