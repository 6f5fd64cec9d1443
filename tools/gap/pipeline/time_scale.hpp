#pragma once

#include <vector>

#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// How much slower (or faster, below 1) the measured motion is than what thresholds.hpp has its seconds for: a machine
/// that moves within a second. 1 for all such machines.
///
/// Of every measured channel the lag at which its autocorrelation, the sensor's noise taken off, falls to one half; of
/// all channels the shortest. From 0.02 s to 2 s (a sinusoid of 8 Hz to 0.08 Hz) the scale is 1, beyond in proportion,
/// and never such that a second of it has fewer than 20 samples or a slow machine's more than 50: who samples often has
/// a reason.
///
/// Cost: a hundred products per sample.
double measure_time_scale(const tiller_config_t& config, const std::vector<Grid>& grids);

}  // namespace tiller::tools::gap
