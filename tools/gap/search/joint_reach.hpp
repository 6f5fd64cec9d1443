#pragma once

#include <vector>

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// Shapes of a force that are free in each window.
constexpr std::size_t kReachShapes = WindowRollout::kLanes;

/// (joints) How much of the cost of `base` on the screen's windows a force at each joint can take off at most: sixteen
/// cosines over a window are free to follow what is left, start states with them, to first order. No effect at that
/// joint whose force is below 8 Hz in a window of 1 s takes off more. Infinite where the response is not known. Cost:
/// a linearisation and a response in sixteen lanes per joint and window.
std::vector<double> joint_reach(Session& s, const Candidate& base);

}  // namespace tiller::tools::gap
