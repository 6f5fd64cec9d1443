#pragma once

#include "tiller/tiller.h"
#include "tools/import/plan_horizon.hpp"

namespace tiller::tools {

/// How far a plan of this task has to look ahead, from its own model at the priors' centre, linear around the start and
/// around the target. needed = 0 where nothing can be said: the goal is a reference, is told by outputs or by a cost of
/// one's own, or the cost goes on behind the horizon (terminal = "lqr"). The configuration must have passed
/// tiller_config_check.
HorizonAdvice advise_horizon(const tiller_config_t& config);

/// One line on the configured horizon: what the model asks for, and whether it is too short for that; "" where the
/// model says nothing.
std::string horizon_text(const tiller_config_t& config);

}  // namespace tiller::tools
