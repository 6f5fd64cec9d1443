#pragma once

#include <cmath>

#include "abi/checks.hpp"

// Definitions that the groups of tiller_config_check share. Conditions are written so that a NaN fails them.

namespace tiller {

// names of array elements: a finding's field is a literal, so that nothing formats text here
#define TILLER_FOUR(f) f "[0]", f "[1]", f "[2]", f "[3]"
#define TILLER_EIGHT(f) TILLER_FOUR(f), f "[4]", f "[5]", f "[6]", f "[7]"
#define TILLER_TWELVE(f) TILLER_EIGHT(f), f "[8]", f "[9]", f "[10]", f "[11]"
#define TILLER_SIXTEEN(f) TILLER_TWELVE(f), f "[12]", f "[13]", f "[14]", f "[15]"
#define TILLER_TWENTY_FOUR(f) \
  TILLER_SIXTEEN(f), f "[16]", f "[17]", f "[18]", f "[19]", f "[20]", f "[21]", f "[22]", f "[23]"
using Names4 = const char* const[4];
using Names8 = const char* const[8];
using Names12 = const char* const[12];
using Names24 = const char* const[24];
static_assert(TILLER_MAX_INPUTS == 4, "names below");
static_assert(TILLER_MAX_EFFECTS == 8, "names below");
static_assert(TILLER_MAX_STATES == 12, "names below");
static_assert(TILLER_MAX_MEASUREMENTS == 12, "names below");
static_assert(TILLER_MAX_PARAMS == 24, "names below");

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

Finding check_planner(const tiller_config_t& c);
Finding check_cost(const tiller_config_t& c);
/// That the LQR cost-to-go exists, if it is asked for; after every other check, since it steps the model.
Finding check_cost_to_go(const tiller_config_t& c);

}  // namespace tiller
