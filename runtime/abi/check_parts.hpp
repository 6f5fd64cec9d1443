#pragma once

#include <cmath>

#include "abi/checks.hpp"
#include "abi/element_names.hpp"
#include "rollout/attitude.hpp"

// Definitions that the groups of tiller_config_check share. Conditions are written so that a NaN fails them.

namespace tiller {

constexpr Finding kGood = {};

// the ranges that tiller.h states
inline bool in(double v, double low, double high) { return v >= low && v <= high; }
inline bool is_value(double v) { return std::fabs(v) <= TILLER_LARGEST_VALUE; }
inline bool is_scale(double v) { return in(v, TILLER_SMALLEST_SCALE, TILLER_LARGEST_SCALE); }
inline bool is_weight(double v) { return v == 0.0 || in(v, TILLER_SMALLEST_WEIGHT, TILLER_LARGEST_WEIGHT); }
inline bool is_parameter(double v) {
  return v == 0.0 || in(std::fabs(v), TILLER_SMALLEST_PARAMETER, TILLER_LARGEST_PARAMETER);
}
inline bool is_scale_or_none(double v) { return v > 0.0 && (std::isinf(v) || is_scale(v)); }
inline bool is_value_or_none(double v) { return std::isinf(v) || is_value(v); }
inline bool in(std::uint32_t v, std::uint32_t low, std::uint32_t high) { return v >= low && v <= high; }

inline bool all_values(const double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i)
    if (!is_value(values[i])) return false;
  return true;
}

/// Rows of states: values, and quaternions of unit length.
inline bool are_states(const tiller_model_t& model, const double* rows, std::size_t count) {
  if (!all_values(rows, count * model.state_count)) return false;
  for (std::size_t k = 0; k < count; ++k)
    if (!are_attitudes(model.quaternion_mask, rows + k * model.state_count)) return false;
  return true;
}

Finding check_planner(const tiller_config_t& c);
/// The network of an effect that reads one: by itself, and beside the model.
Finding check_networks(const tiller_config_t& c);
/// The policy of the planner `policy`; after the priors, which it may read.
Finding check_policy(const tiller_config_t& c);
Finding check_cost(const tiller_config_t& c);
/// That the LQR cost-to-go exists, if it is asked for; after every other check, since it steps the model.
Finding check_cost_to_go(const tiller_config_t& c);

}  // namespace tiller
