#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// What a policy may look at: one state, and moments of the hypotheses' parameters.
struct PolicyView {
  const double* state = nullptr;         // (nx)
  const double* param_mean = nullptr;    // (np)
  const double* param_sd = nullptr;      // (np)
  const double* last_command = nullptr;  // (nu)
  std::uint64_t task_step = 0;           // of the reference's row
};

/// Number of inputs of a policy that reads `reads` (tiller_policy_input_t) on this robot.
std::uint32_t policy_input_count(const tiller_config_t& config, std::uint32_t reads);

/// in (policy_input_count): as tiller_policy_input_t orders them. A goal is the reference's row where there is one,
/// else the target.
void fill_policy_inputs(const tiller_config_t& config, std::uint32_t reads, const PolicyView& view, double* in);

/// command (nu) that a network's outputs (nu) stand for, within the limits.
void squash_outputs(const tiller_config_t& config, std::uint32_t squash, const double* out, double* command);

}  // namespace tiller
