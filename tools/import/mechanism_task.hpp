#pragma once

#include <vector>

#include "tools/import/model_writer.hpp"
#include "tools/import/plan_horizon.hpp"

namespace tiller::tools {

/// Fills what a task needs of the robot itself: one period around `start` and `target` (bodies), at rest, and the way
/// between them, in the order of the model's states. Dry friction is left out. task.period_s is set.
void linearise_mechanism(const Mechanism& mechanism, const ModelNames& names, const std::vector<double>& start,
                         const std::vector<double>& target, LinearTask& task);

}  // namespace tiller::tools
