#pragma once

#include <cstdint>

#include "rollout/rollout.hpp"

namespace tiller {

/// Regressors of a discrepancy that a transition can carry.
constexpr std::uint32_t kMaxBasis = 4;
/// Steps that are summed in single precision before they are added to the double sums.
constexpr std::uint32_t kResidualBlock = 64;

/// A transition between two measured states, as residuals are taken from it. Everything but `change` is finite.
struct MeasuredStep {
  double state[TILLER_MAX_STATES] = {};   // (nx) measured at its beginning
  double change[TILLER_MAX_STATES] = {};  // (nx) measured end minus beginning, angles wrapped; NaN: the row is missing
  double input[TILLER_MAX_INPUTS] = {};   // (nu) command in force
  double period_s = 0.0;                  // 0: the setup's
  double weight = 1.0;                    // 0..1, robust and forgetting weight in one
  const double* history = nullptr;        // (delay_steps x nu) commands before, newest first; null without delay
  double basis[kMaxBasis] = {};           // (basis_count) regressors of the discrepancy, shared by all lanes
};

/// One-step residuals e = (measured change) - (f(x, u; theta) - x) of many parameter vectors theta (the lanes) at
/// recorded transitions. f(x) - x is formed from its increments, not as a difference, so single precision loses
/// nothing: the error is a few 1e-7 of the change, not of the state. The state is shared by the lanes: sines and the
/// like that depend on it alone are computed once per transition.
///
/// Sums are added to what the outputs hold; a lane whose step is not finite makes its own sums not finite, whatever the
/// weight. Missing rows add nothing to the sums; their residual is NaN. A lane's bits depend on nothing but its
/// parameters and the steps. The setup has no effects with states of their own (effect_state_count = 0).
/// Cost: about 0.3 ns per lane and step (cart-pole, semi-implicit Euler, AVX-512); see ./dev bench residual.
struct ResidualJob {
  const StepSetup* setup = nullptr;
  std::uint32_t lanes = 0;  // a multiple of kLanePadding
  std::uint32_t count = 0;  // steps
  const MeasuredStep* steps = nullptr;
  std::uint32_t basis_count = 0;  // 0..kMaxBasis
  std::uint32_t basis_rows = 0;   // bit r: state r has the basis; the other rows of `projected` are left as they are
  Lanes<float> params;            // (np) the model's, then the effects'
  double* squared = nullptr;      // (nx x lanes) += sum_k weight_k e_kr^2; nullable
  double* projected = nullptr;    // (nx * basis_count x lanes) row r * basis_count + j += sum_k weight_k basis_kj e_kr;
                                  // nullable
  float* residual = nullptr;      // (count * nx x lanes) row k * nx + r = e_kr, unweighted; nullable
};

}  // namespace tiller
