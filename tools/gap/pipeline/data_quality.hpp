#pragma once

#include <vector>

#include "tools/gap/result/result.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Whether data can answer at all, before anything is fitted: fills result.noise_ratio and, where they cannot,
/// result.reasons (what is wrong, in which file, how to mend it); what is merely odd goes to result.notes.
///
///   enough seconds, every channel moves, noise as the robot file says (to a factor of ten)
///   an input that moves, or a model that explains most of a free motion
///   units and signs (unit_check.hpp)
///
/// Cost: 10 ms for 48 s at 100 Hz; a few times that where units are in doubt.
void check_data_quality(const tiller_config_t& config, const std::vector<Grid>& grids, const volatile int* stop,
                        Result& result);

/// (nu) Whether an input changes in any of the logs: effects of one that does not cannot be told.
std::vector<bool> inputs_that_move(const tiller_config_t& config, const std::vector<Grid>& grids);

}  // namespace tiller::tools::gap
