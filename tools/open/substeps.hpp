#pragma once

#include <string>

#include "tiller/tiller.h"
#include "tools/robot/robot_file.hpp"
#include "tools/robot/substep_advice.hpp"

namespace tiller::tools {

/// Of the noise: an error below that share is not seen.
constexpr double kStepErrorTolerance = 0.1;

/// Whether the advised number keeps the error below the tolerance: no number may.
inline bool is_enough(const SubstepAdvice& advice) { return advice.advised.share <= kStepErrorTolerance; }

/// The error is local: one period from states that the robot visits, which is what posterior and planner use; an error
/// that grows over a long open loop is not the integrator's. The states are those of a short closed loop at the task
/// (visit_states) and of 4 periods from 25 of its points in 16 lanes, with parameters drawn from the priors and inputs
/// that wander about the loop's by a tenth of their range, by a fixed seed. The configuration must have passed
/// tiller_config_check. States without process noise are left out.
SubstepAdvice advise_substeps(const tiller_config_t& config);

/// "0.05 of the noise expected of rate_rad_s in a period (below 0.1 with 2 substeps)", of the configured substeps.
std::string step_error_text(const RobotFile& robot);

}  // namespace tiller::tools
