#pragma once

#include "tiller/config.hpp"

namespace tiller::tools {

/// The largest eigenvalue of the model's equations in 1/s, with parameters at their priors' centres, by central
/// differences about a state (nx) under an input (nu): of a step of that time an integrator follows nothing. 0: none,
/// as of a mass that nothing holds, or not finite, or a model without `dynamics`. Cost: 2 nx evaluations of the dynamics.
double fastest_rate_1_s(const tiller_config_t& config, const double* state, const double* input);

}  // namespace tiller::tools
