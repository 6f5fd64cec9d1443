#pragma once

#include <cstdint>

#include "rollout/rollout.hpp"

namespace tiller {

/// A path is what gradient planners linearise around: for M scenarios (particles) N periods under one input sequence,
/// stage-major and row-major like rollout/lq.hpp. Its state is the model's with the effects' behind it, z = (x, s),
/// nz = nx + ns. The setup has no input delay (planners bring the state forward over it).

/// z+ = f(z, u) with its Jacobians at every point of a path.
struct PathJob {
  const StepSetup* setup = nullptr;
  double period_s = 0.0;  // 0: the setup's
  std::uint32_t horizon = 0;
  std::uint32_t scenarios = 1;
  const double* state = nullptr;    // (N x M x nz)
  const double* control = nullptr;  // (N x nu)
  const double* params = nullptr;   // (M x np) the model's, then the effects'
  std::uint32_t param_count = 0;    // np
  double* next = nullptr;           // (N x M x nz)
  // Nullable, both or none. Blocks of n x n and n x nu for an n >= nz (a linear-quadratic problem may have states of
  // its own behind z): only the first nz rows and columns are written.
  double* a = nullptr;          // (N x M x n x n)
  double* b = nullptr;          // (N x M x n x nu)
  std::uint32_t lq_states = 0;  // n
};

/// Candidates of a line search, worked off at once, a lane each.
constexpr std::uint32_t kCandidates = 8;

/// Rolls the model out under u_k = cut(control_k + alpha step_k + beta gain_k (z - state_k)) for every pair (alpha,
/// beta), cut to the limits, to the rate of change and to the cones. The gain acts on all M scenarios' deviations; each
/// alpha has one input sequence.
struct FeedbackJob {
  const StepSetup* setup = nullptr;
  double period_s = 0.0;
  std::uint32_t horizon = 0;
  std::uint32_t scenarios = 1;
  const double* start = nullptr;           // (M x nz)
  const double* params = nullptr;          // (M x np)
  std::uint32_t param_count = 0;           // np
  const double* state = nullptr;           // (N x M x nz) the path
  const double* control = nullptr;         // (N x nu)
  const double* step = nullptr;            // (N x nu)
  const double* gain = nullptr;            // (N x nu x M n)
  std::uint32_t lq_states = 0;             // n >= nz; with n = nz + nu the last nu columns act on the input before
  const double* alpha = nullptr;           // (kCandidates)
  const double* beta = nullptr;            // (kCandidates)
  const double* low = nullptr;             // (nu)
  const double* high = nullptr;            // (nu)
  const double* most_change = nullptr;     // (nu) per period; infinity for none
  const double* previous_input = nullptr;  // (nu) command in force
  const InputCones* cones = nullptr;       // kept after limits and changes; null: none
  const CostTerms<double>* cost = nullptr;
  std::uint64_t task_step = 0;    // time row of the first step
  double* cost_out = nullptr;     // (M x kCandidates)
  double* state_out = nullptr;    // (N+1 x M x nz x kCandidates)
  double* control_out = nullptr;  // (N x nu x kCandidates)
};

/// Kernels of gradient planners, beside the rollouts.
struct PathKernel {
  void (*linearise)(const tiller_model_t& model, const PathJob& job) = nullptr;
  void (*feedback)(const tiller_model_t& model, const FeedbackJob& job) = nullptr;
};

/// The table's, or the loop over a model in C where it has none.
const PathKernel& select_path(const RolloutTable& table);

}  // namespace tiller
