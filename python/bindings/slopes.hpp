#pragma once

#include <cstdint>

#include "jax_robot.hpp"

namespace tiller::python {

/// Derivatives of every period along trajectories: with z = (x, s), the model's states and the effects',
///
///     dz' = a dz + b du + p dparams
///
/// a and b are the kernel's own, by dual numbers. p is central differences of the kernel in double, within the support
/// of the priors, to some 1e-9 of its size: dual numbers by parameters would be another third of a kernel's text.
/// States are components: of a quaternion four, and the step's return to unit length is in a. The setup has no input
/// delay.
struct SlopesJob {
  const JaxRobot* robot = nullptr;
  std::uint32_t trajectories = 0;  // n
  std::uint32_t horizon = 0;       // H
  bool shared_params = false;
  const double* states = nullptr;    // (n x H + 1 x nx)
  const double* controls = nullptr;  // (n x H x nu)
  const double* params = nullptr;    // (n x np), or (np) where shared
  double* a = nullptr;               // (n x H x nz x nz)
  double* b = nullptr;               // (n x H x nz x nu)
  double* p = nullptr;               // (n x H x nz x np); null: not wanted
};

void find_slopes(const SlopesJob& job);

/// Derivatives of a trajectory's cost, as the kernel counts it, with the states taken for free variables.
struct CostSlopesJob {
  const JaxRobot* robot = nullptr;
  std::uint32_t horizon = 0;         // H
  const double* states = nullptr;    // (H + 1 x nx)
  const double* controls = nullptr;  // (H x nu)
  const double* params = nullptr;    // (np)
  double* by_state = nullptr;        // (H + 1 x nx)
  double* by_control = nullptr;      // (H x nu)
  double* by_param = nullptr;        // (np): zero but for costs of outputs and of one's own
};

void find_cost_slopes(const CostSlopesJob& job);

}  // namespace tiller::python
