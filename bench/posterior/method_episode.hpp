#pragma once

// The accuracy benchmark's episodes as the methods of `tiller identify` take them, and what planning with a fitted
// model is worth.

#include <vector>

#include "harness/accuracy/accuracy_tasks.hpp"
#include "tools/identify/method.hpp"

namespace tiller::bench {

/// The first `ticks` transitions of an episode on a grid.
tools::Grid grid_of(const AccuracyTask& task, const Episode& episode, std::uint32_t ticks);

/// Swing-up of the true pendulum by MPPI that plans with `params`: mean over `ticks` of (1 - cos angle) / 2, which is 0
/// hanging, 1 upright. The torque is limited to half of what holds the true pendulum level, so it must be pumped.
double swing_up_return(const AccuracyTask& pendulum, const std::vector<double>& truth,
                       const std::vector<double>& params, std::uint32_t ticks, std::uint64_t seed);

}  // namespace tiller::bench
