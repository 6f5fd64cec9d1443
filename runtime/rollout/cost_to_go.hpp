#pragma once

#include "rollout/rollout.hpp"

namespace tiller {

/// P of the infinite-horizon cost-to-go d' P d around the cost's target, (nx x nx) row-major; false where there is
/// none. See lay_out_cost.
bool lqr_cost_to_go(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table, double* p);

}  // namespace tiller
