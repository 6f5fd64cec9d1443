#pragma once

#include <vector>

#include "tools/logs/identify_data.hpp"

namespace tiller::tools {

/// How much of the configured process noise the data speak for, as a factor of process_sd in (0, 1]: the root of its
/// posterior mean square, by 16 nodes from 1 down to 0.0055 and the likelihood of all innovations at `params` (np),
/// with the common scale of process and sensor noise integrated out and a prior that is even in the factor. The
/// posterior estimates that one scale; a robot file that leaves room for what the model may lack would otherwise leave
/// intervals as wide as this room, on data that need none of it. Never above 1: more than the configured noise is an
/// error of the model, which the common scale tells. 1 where there are too few data to say.
double estimate_process_scale(const tiller_config_t& config, const std::vector<double>& params, double noise_scale,
                              const std::vector<Stretch>& stretches);

}  // namespace tiller::tools
