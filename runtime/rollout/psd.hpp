#pragma once

#include "rollout/model_adapter.hpp"

namespace tiller {

/// The nearest positive semidefinite matrix (Frobenius) to a symmetric one: eigenvalues below zero become zero. In
/// place, (n x n) row-major, n <= kMax; every lane has its own matrix, and one that is semidefinite keeps its bits.
/// Eigenvectors by cyclic Jacobi rotations (Golub and Van Loan, Matrix Computations, 8.5), at most 12 sweeps; what is
/// put together from them is semidefinite however far they came. Cost: about 4 n^3 multiplications a sweep, five sweeps
/// as a rule.
template <int kMax, class S>
TILLER_INLINE void clip_negative_eigenvalues(S* h, int n) {
  S a[kMax][kMax], v[kMax][kMax];
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) {
      a[r][c] = h[r * n + c];
      v[r][c] = S(r == c ? 1.0 : 0.0);
    }
  for (int sweep = 0; sweep < 12; ++sweep) {
    S off = S(0.0), size = S(0.0);
    for (int r = 0; r < n; ++r)
      for (int c = 0; c < n; ++c) {
        size = size + a[r][c] * a[r][c];
        if (r != c) off = off + a[r][c] * a[r][c];
      }
    if (!any(off > size * S(1e-30))) break;
    for (int p = 0; p < n; ++p)
      for (int q = p + 1; q < n; ++q) {
        const auto turns = abs(a[p][q]) > S(0.0);
        const S theta = (a[q][q] - a[p][p]) / (S(2.0) * select(turns, a[p][q], S(1.0)));
        const S size_t = S(1.0) / (abs(theta) + sqrt(theta * theta + S(1.0)));
        const S tangent = select(turns, copysign(size_t, theta), S(0.0));
        const S cosine = S(1.0) / sqrt(tangent * tangent + S(1.0)), sine = tangent * cosine;
        for (int k = 0; k < n; ++k) {
          const S one = a[k][p], other = a[k][q];
          a[k][p] = cosine * one - sine * other;
          a[k][q] = sine * one + cosine * other;
        }
        for (int k = 0; k < n; ++k) {
          const S one = a[p][k], other = a[q][k];
          a[p][k] = cosine * one - sine * other;
          a[q][k] = sine * one + cosine * other;
          const S axis = v[k][p], next = v[k][q];
          v[k][p] = cosine * axis - sine * next;
          v[k][q] = sine * axis + cosine * next;
        }
      }
  }
  S least = a[0][0];  // NOLINT(clang-analyzer-core.uninitialized.Assign): n is at least 1
  for (int i = 1; i < n; ++i) least = min(least, a[i][i]);
  const auto keeps = least >= S(0.0);
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) {
      S sum = S(0.0);
      for (int k = 0; k < n; ++k) sum = sum + max(a[k][k], S(0.0)) * v[r][k] * v[c][k];
      h[r * n + c] = select(keeps, h[r * n + c], sum);
    }
}

}  // namespace tiller
