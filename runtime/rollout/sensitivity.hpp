#pragma once

#include <cstddef>
#include <cstdint>

#include "rollout/rollout.hpp"

namespace tiller {

/// One period at many points, with its derivatives by everything that it depends on: with z = (x, s), the model's states
/// and the effects' (nz = nx + ns),
///
///     dz' = a dz + b du + c dp
///
/// by dual numbers. Rows of points, one behind the other. The setup has no input delay and no forces that fade. Planners
/// never move parameters, so that this is no part of their tables: whoever fits parameters on the host links it.
struct SensitivityJob {
  const StepSetup* setup = nullptr;
  std::uint32_t points = 0;           // n
  std::uint32_t points_a_set = 1;     // points that share a row of parameters
  const double* state = nullptr;      // (n x nz)
  const double* control = nullptr;    // (n x nu)
  const double* params = nullptr;     // (n / points_a_set x np) the model's, then the effects'
  std::uint32_t param_count = 0;      // np
  double* a = nullptr;                // (n x nz x nz)
  double* b = nullptr;                // (n x nz x nu)
  double* c = nullptr;                // (n x nz x np)
};

struct SensitivityTable {
  void (*run)(const SensitivityJob& job);
};

/// Of a model that tiller ships (tiller_builtin_model); null: of any other one.
const SensitivityTable* find_sensitivity(const tiller_model_t& model);

}  // namespace tiller
