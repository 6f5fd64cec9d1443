#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::tools {

/// The discretisation error of one period, against the random change that the configuration expects in it.
struct StepError {
  double share = 0.0;  ///< worst state's RMS error over its noise, process_sd * sqrt(period)
  std::uint32_t worst_state = 0;
};

/// Discretisation against noise, by step halving: how many substeps the period needs so that the error which the
/// integrator makes in one period stays below a tenth of the random change that the configuration expects in it. Above
/// that the posterior takes the integrator's error for physics.
struct SubstepAdvice {
  std::uint32_t needed = 1;  ///< 1, 2, 4, ... 64; 64 also if even that is not enough
  StepError configured;      ///< with config.substeps
  StepError advised;         ///< with `needed`
};

/// The error is local: one period from states that the robot visits, which is what posterior and planner use; an error
/// that grows over a long open loop is not the integrator's. The states are those of a short closed loop at the task
/// (visit_states) and of 4 periods from 25 of its points in 16 lanes, with parameters drawn from the priors and inputs
/// that wander about the loop's by a tenth of their range, by a fixed seed. The configuration must have passed
/// tiller_config_check. States without process noise are left out.
SubstepAdvice advise_substeps(const tiller_config_t& config);

}  // namespace tiller::tools
