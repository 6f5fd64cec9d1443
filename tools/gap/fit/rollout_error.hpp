#pragma once

#include <vector>

#include "tiller/config.hpp"
#include "tools/gap/fit/windows.hpp"

namespace tiller::tools::gap {

/// The measure of `tiller gap`, of given parameters (np): normalised RMS error of rollouts over windows of kWindow_s,
/// each from the start state that fits it best. 1: noise alone; up to kExplained_sigma the model explains the logs.
/// NaN: no window fits into the logs. At most kMostErrorWindows windows, evenly chosen.
double rollout_error_sigma(const tiller_config_t& config, std::vector<Grid> grids, const std::vector<double>& params);

}  // namespace tiller::tools::gap
