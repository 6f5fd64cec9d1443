#pragma once

#include <cstdint>

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

}  // namespace tiller::tools
