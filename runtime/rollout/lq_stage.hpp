#pragma once

// The inputs of one stage, given a quadratic cost to go: hold, factorise, gains. Any m.

#include <cmath>
#include <cstdint>

#include "rollout/lq.hpp"
#include "rollout/model_adapter.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace lq {

/// Lower Cholesky factor of the free block in place, diagonal inverted; rows of held inputs become unit rows.
template <class Count>
TILLER_INLINE bool cholesky_free(Count m, const std::int8_t* held, const double* curvature, double* l) {
  bool good = true;
  for (int i = 0; i < m; ++i) {
    const bool fixed_row = held && held[i];
    for (int j = 0; j <= i; ++j) {
      double sum = fixed_row || (held && held[j]) ? (i == j ? 1.0 : 0.0) : curvature[i * m + j];
      for (int k = 0; k < j; ++k) sum -= l[i * m + k] * l[j * m + k];
      if (i == j) {
        good = good && sum > 0.0;  // false for NaN
        l[i * m + i] = 1.0 / std::sqrt(sum);
      } else {
        l[i * m + j] = sum * l[j * m + j];
      }
    }
    for (int j = i + 1; j < m; ++j) l[i * m + j] = 0.0;
  }
  return good;
}

/// rows (m x width, row-major) := -(L L')^-1 rows, column by column in lanes of the width.
template <class Count, class Width>
TILLER_INLINE void solve_rows(Count m, const double* l, Width width, double* rows) {
  for (int i = 0; i < m; ++i) {
    for (int k = 0; k < i; ++k)
      for (int j = 0; j < width; ++j) rows[i * width + j] -= l[i * m + k] * rows[k * width + j];
    for (int j = 0; j < width; ++j) rows[i * width + j] *= l[i * m + i];
  }
  for (int i = m - 1; i >= 0; --i) {
    for (int k = i + 1; k < m; ++k)
      for (int j = 0; j < width; ++j) rows[i * width + j] -= l[k * m + i] * rows[k * width + j];
    for (int j = 0; j < width; ++j) rows[i * width + j] *= l[i * m + i];
  }
  for (int i = 0; i < m * width; ++i) rows[i] = -rows[i];
}

/// x (m) := -(L L')^-1 x. What is known is taken out of all that is not: short chains.
template <class Count>
TILLER_INLINE void solve_vector(Count m, const double* l, double* x) {
  for (int k = 0; k < m; ++k) {
    const double known = x[k] *= l[k * m + k];
    for (int i = k + 1; i < m; ++i) x[i] -= l[i * m + k] * known;
  }
  for (int k = m - 1; k >= 0; --k) {
    const double known = x[k] *= l[k * m + k];
    for (int i = 0; i < k; ++i) x[i] -= l[k * m + i] * known;
  }
  for (int i = 0; i < m; ++i) x[i] = -x[i];
}

/// Step of one stage from the gradient `force` (m): free inputs to their minimum, held ones to their bounds.
template <class Count>
TILLER_INLINE void stage_step(Count m, const LqProblem& p, const LqFactor& f, std::size_t k, const double* curvature,
                              const double* force, double* step) {
  const std::int8_t* held = f.held ? f.held + k * m : nullptr;
  for (int i = 0; i < m; ++i) {
    step[i] = force[i];
    if (!held) continue;
    if (held[i]) {
      step[i] = -(held[i] < 0 ? p.low : p.high)[k * m + i];
    } else {
      for (int j = 0; j < m; ++j)
        if (held[j]) step[i] += curvature[i * m + j] * (held[j] < 0 ? p.low : p.high)[k * m + j];
    }
  }
  solve_vector(m, f.cholesky + k * m * m, step);
}

/// Gains of one stage from `carry` (m x width): rows of held inputs are zero.
template <class Count, class Width>
TILLER_INLINE void stage_gain(Count m, Width width, const std::int8_t* held, const double* l, const double* carry,
                              double* gain) {
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < width; ++j) gain[i * width + j] = held && held[i] ? 0.0 : carry[i * width + j];
  solve_rows(m, l, width, gain);
}

}  // namespace lq

TILLER_ISA_NAMESPACE_END
