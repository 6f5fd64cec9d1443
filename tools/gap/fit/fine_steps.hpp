#pragma once

#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// The robot file's configuration with steps so fine that the integrator's own error does not look like physics: at
/// most kSubstep_s times the time scale of `grid`. Friction acts after a free step, in which a state behind a joint
/// (the force of a load cell, a pressure) sees the joint move freely: such a model takes at most kSubstepRate of its
/// fastest motion in the log, too. At most 64 steps a period.
Config with_fine_steps(const tiller_config_t& config, const Grid& grid);

}  // namespace tiller::tools::gap
