#pragma once

// Quadratic forms in lanes, for the posterior's sources that are compiled once per instruction set.

#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// x' G x, G as its upper triangle row by row: 2 sum_i x_i (G_ii x_i / 2 + sum_j>i G_ij x_j).
inline Pack<double> quadratic_form(const double* gram, const Pack<double>* x, std::uint32_t size) {
  using P = Pack<double>;
  P sum(0.0);
  for (std::uint32_t i = 0; i < size; ++i) {
    P along = P(0.5 * gram[0]) * x[i];
    for (std::uint32_t j = i + 1; j < size; ++j) along = fma(P(gram[j - i]), x[j], along);
    sum = fma(x[i], along, sum);
    gram += size - i;
  }
  return sum + sum;
}

TILLER_ISA_NAMESPACE_END
