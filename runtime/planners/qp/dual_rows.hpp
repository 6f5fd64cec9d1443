#pragma once

#include <cstddef>

#include "scalar/isa.hpp"

namespace tiller {

/// What the dual active set (dual_set.hpp) spends its time in, once per instruction set.
struct DualRows {
  /// out = base + sum_j share[j] column[j], each `length` long; base null: zero.
  void (*combine)(const double* base, const double* const* column, const double* share, std::size_t count,
                  std::size_t length, double* out) = nullptr;
  /// The largest of v - high and low - v, and where it is; NaN where some v is not finite.
  double (*worst)(const double* v, const double* low, const double* high, std::size_t length,
                  std::size_t* at) = nullptr;
};

const DualRows& select_dual_rows();

}  // namespace tiller
