#pragma once

#include <vector>

#include "tools/gap/result/result.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Whether data can answer at all, before anything is fitted: fills result.noise_ratio and, where they cannot,
/// result.reasons (what is wrong, in which file, how to mend it); what is merely odd goes to result.notes.
///
///   enough seconds, every channel and some input move, noise as the robot file says (to a factor of ten)
///   units and signs: where the model explains nothing of the accelerations and, with one channel in degrees, in
///   thousandths or reversed, nearly all of them, that channel is what is wrong and not the physics
///
/// Cost: 10 ms for 48 s at 100 Hz; a few times that where units are in doubt.
void check_data_quality(const tiller_config_t& config, const std::vector<Grid>& grids, Result& result);

}  // namespace tiller::tools::gap
