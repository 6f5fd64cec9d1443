#pragma once

#include <cstdint>
#include <string>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Discretisation against noise, by step halving: how many substeps the period needs so that the error which the
/// integrator makes in one period stays below a tenth of the random change that the configuration expects in it
/// (process_sd * sqrt(period)). Above that the posterior takes the integrator's error for physics.
struct SubstepAdvice {
  std::uint32_t needed = 1;  ///< 1, 2, 4, ... 64; 64 also if even that is not enough
  double error_share = 0.0;  ///< with the configured substeps: worst state's RMS error over its noise
  std::uint32_t worst_state = 0;
};

/// The states and inputs tried are those of trajectories from the start state under random inputs within the limits,
/// parameters drawn from the priors: 16 trajectories of `horizon` periods, by a fixed seed. The configuration must
/// have passed tiller_config_check. States without process noise are left out.
SubstepAdvice advise_substeps(const tiller_config_t& config);

}  // namespace tiller::tools
