#pragma once

// The Riccati sweeps of a linear-quadratic problem (runtime/rollout/lq.hpp) for n states and m inputs known to the
// compiler, M = 1: every matrix is a few registers. In the problem's terms, with P, p the cost to go of stage k + 1:
//
//     s = p + P c     Hxx = qxx + a' P a     Hux = qux + b' P a     Huu = quu + b' P b     h = qu + b' s
//     gain = -Huu^-1 Hux     step = -Huu^-1 h     P = Hxx + Hux' gain     p = qx + a' s + Hux' step
//
// The short form of the last two holds for held inputs too (their gain is zero, their step the bound).

#include "rollout/lq_row.hpp"
#include "rollout/lq_stage.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace lq {

template <int n, int m>
struct Sweep {
  using X = Row<n>;
  using U = Row<m>;

  template <int rows, int w>
  static TILLER_INLINE void load(const double* p, Row<w> (&r)[rows]) {
#pragma GCC unroll 16
    for (int k = 0; k < rows; ++k) r[k] = Row<w>::load(p + k * w);
  }

  /// s = p + P c, of the stage after k.
  static TILLER_INLINE void carried_slope(const LqProblem& p, std::size_t k, const X* value, const X& slope,
                                          double* out) {
    X s = slope;
    if (p.c) s.add(combine<n>(p.c + k * n, 1, value));
    s.store(out);
  }

  static bool factorise(const LqProblem& p, const LqFactor& f) {
    const std::size_t horizon = p.stands_from ? p.stands_from : p.horizon;
    X value[n];
    if (!p.stands_from) {
      load(p.qxx + horizon * n * n, value);
      for (int i = 0; i < n; ++i) value[i].store(f.value + (horizon * n + i) * n);
      if (p.state_diagonal)
        for (int i = 0; i < n; ++i) f.value[(horizon * n + i) * n + i] += p.state_diagonal[horizon * n + i];
      X::load(p.qx + horizon * n).store(f.slope + horizon * n);
    }
    load(f.value + horizon * n * n, value);
    X slope = X::load(f.slope + horizon * n);
    bool good = true;
    for (std::size_t k = horizon; k-- > 0;) {
      const double *a = p.a + k * n * n, *b = p.b + k * n * m;
      const double* ahead = f.value + (k + 1) * n * n;
      X a_rows[n], pa[n], carry[m];
      U b_rows[n], curvature[m];
      load(a, a_rows);
      load(b, b_rows);
#pragma GCC unroll 16
      for (int i = 0; i < n; ++i) pa[i] = combine<n>(ahead + i * n, 1, a_rows);
      double s[n];
      carried_slope(p, k, value, slope, s);

      double *curvature_out = f.curvature + k * m * m, *carry_out = f.carry + k * m * n, *force = f.force + k * m;
      for (int i = 0; i < m; ++i) {
        double pb[n];  // row i of b' P
        combine<n>(b + i, m, value).store(pb);
        curvature[i] = U::load(p.quu + (k * m + i) * m);
        curvature[i].add(combine<n>(pb, 1, b_rows));
        curvature[i].store(curvature_out + i * m);
        carry[i] = combine<n>(b + i, m, pa);
        if (p.qux) carry[i].add(X::load(p.qux + (k * m + i) * n));
        carry[i].store(carry_out + i * n);
        curvature_out[i * m + i] += p.regularisation;
        if (p.input_diagonal) curvature_out[i * m + i] += p.input_diagonal[k * m + i];
      }
      U h = U::load(p.qu + k * m);
      h.add(combine<n>(s, 1, b_rows));
      h.store(force);

      const std::int8_t* held = f.held ? f.held + k * m : nullptr;
      double *l = f.cholesky + k * m * m, *gain = f.gain + k * m * n, *step = f.step + k * m;
      good &= cholesky_free(Index<m>{}, held, curvature_out, l);
      stage_step(Index<m>{}, p, f, k, curvature_out, force, step);
      stage_gain(Index<m>{}, Index<n>{}, held, l, carry_out, gain);
      X gain_rows[m];
      load(gain, gain_rows);

      // cost to go of this stage
      slope = X::load(p.qx + k * n);
      slope.add(combine<n>(s, 1, a_rows));
      slope.add(combine<m>(step, 1, carry));
      slope.store(f.slope + k * n);
      double* value_out = f.value + k * n * n;
#pragma GCC unroll 16
      for (int i = 0; i < n; ++i) {
        value[i] = X::load(p.qxx + (k * n + i) * n);
        value[i].add(combine<n>(a + i, n, pa));
        value[i].add(combine<m>(carry_out + i, n, gain_rows));
        value[i].store(value_out + i * n);
      }
      if (p.state_diagonal) {
        for (int i = 0; i < n; ++i) value_out[i * n + i] += p.state_diagonal[k * n + i];
        load(value_out, value);
      }
      // Rounding must not let the two triangles part company. The registers keep theirs: read back here, they would
      // wait for the stores; the products with a, which carry P on, read the memory.
#pragma GCC unroll 16
      for (int i = 1; i < n; ++i)
        for (int j = 0; j < i; ++j) value_out[i * n + j] = value_out[j * n + i];
    }
    return good;
  }

  static void resolve(const LqProblem& p, const LqFactor& f) {
    const std::size_t horizon = p.horizon;
    X slope = X::load(p.qx + horizon * n);
    slope.store(f.slope + horizon * n);
    for (std::size_t k = horizon; k-- > 0;) {
      X a_rows[n], value[n], carry[m];
      U b_rows[n];
      load(p.a + k * n * n, a_rows);
      load(p.b + k * n * m, b_rows);
      load(f.value + (k + 1) * n * n, value);
      load(f.carry + k * m * n, carry);
      double s[n];
      carried_slope(p, k, value, slope, s);
      U h = U::load(p.qu + k * m);
      h.add(combine<n>(s, 1, b_rows));
      h.store(f.force + k * m);
      stage_step(Index<m>{}, p, f, k, f.curvature + k * m * m, f.force + k * m, f.step + k * m);
      slope = X::load(p.qx + k * n);
      slope.add(combine<n>(s, 1, a_rows));
      slope.add(combine<m>(f.step + k * m, 1, carry));
      slope.store(f.slope + k * n);
    }
  }

  static void roll(const LqProblem& p, const LqFactor& f, double* x, double* u) {
    for (std::size_t k = 0; k < p.horizon; ++k) {
      const double *a = p.a + k * n * n, *b = p.b + k * n * m, *gain = f.gain + k * m * n, *at = x + k * n;
      double *next = x + (k + 1) * n, *input = u + k * m;
#pragma GCC unroll 16
      for (int i = 0; i < m; ++i) {
        double sum = f.step[k * m + i];
        for (int j = 0; j < n; ++j) sum += gain[i * n + j] * at[j];
        input[i] = sum;
      }
#pragma GCC unroll 16
      for (int i = 0; i < n; ++i) {
        double sum = p.c ? p.c[k * n + i] : 0.0;
        for (int j = 0; j < n; ++j) sum += a[i * n + j] * at[j];
        for (int j = 0; j < m; ++j) sum += b[i * m + j] * input[j];
        next[i] = sum;
      }
    }
  }

  static void multipliers(const LqProblem& p, const LqFactor& f, const double* x, double* lambda) {
    for (std::size_t k = 0; k <= p.horizon; ++k) {
      X value[n];
      load(f.value + k * n * n, value);
      X row = X::load(f.slope + k * n);
      row.add(combine<n>(x + k * n, 1, value));
      row.store(lambda + k * n);
    }
  }

  static constexpr LqKernel kernel() {
    return {static_cast<std::uint32_t>(n), static_cast<std::uint32_t>(m), &factorise, &resolve, &roll, &multipliers};
  }
};

}  // namespace lq

TILLER_ISA_NAMESPACE_END
