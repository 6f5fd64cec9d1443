#pragma once

// The same sweeps for M systems under one input sequence, and for sizes that only run time knows (n or m is 0). The
// value function couples the systems through the shared input, so it is a full matrix of M x M blocks; the dynamics are
// block-diagonal, so a stage costs 2 M^2 n^3 products and not (M n)^3.

#include "rollout/lq_row.hpp"
#include "rollout/lq_stage.hpp"
#include "rollout/lq_tiles.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace lq {

template <int kStates, int kInputs>
struct ScenarioSweep {
  /// Sizes as constants where they are known.
  struct Sizes {
    int states, inputs, count, stack;
    explicit Sizes(const LqProblem& p)
        : states(static_cast<int>(p.states)),
          inputs(static_cast<int>(p.inputs)),
          count(static_cast<int>(p.scenarios)),
          stack(n() * count) {}
    TILLER_INLINE int n() const { return kStates ? kStates : states; }
    TILLER_INLINE int m() const { return kInputs ? kInputs : inputs; }
  };

  /// States from here on neither follow from the states before nor does anything follow from them, as the last inputs
  /// where their rate costs: rows and columns of a (n x n) that are zero.
  static int live_states(const double* a, int n) {
    int live = n;
    while (live > 1 && all_zero(a + (live - 1) * n, n)) --live;
    for (int r = 0; r < live && live < n; ++r)
      if (!all_zero(a + r * n + live, n - live)) return n;
    return live;
  }
  static TILLER_INLINE bool all_zero(const double* row, int count) {
    bool zero = true;
    for (int i = 0; i < count; ++i) zero &= row[i] == 0.0;
    return zero;
  }

  static TILLER_INLINE void copy(const double* row, int width, double* out) {
    for (int j = 0; j < width; ++j) out[j] = row ? row[j] : 0.0;
  }

  /// value (s x s) := blocks of qxx, and the additions to its diagonal
  static void set_blocks(const LqProblem& p, const Sizes& z, std::size_t k, double* value) {
    const int n = z.n();
    const std::size_t s = static_cast<std::size_t>(z.stack);
    const double* block = p.qxx + k * s * n;
    for (std::size_t i = 0; i < s * s; ++i) value[i] = 0.0;
    for (int j = 0; j < z.count; ++j)
      for (int r = 0; r < n; ++r) copy(block + (j * n + r) * n, n, value + (j * n + r) * s + j * n);
    if (p.state_diagonal)
      for (std::size_t i = 0; i < s; ++i) value[i * s + i] += p.state_diagonal[k * s + i];
  }

  /// value (s x s) := its upper half, mirrored, with blocks of qxx and the additions to its diagonal
  static void add_blocks(const LqProblem& p, const Sizes& z, std::size_t k, double* value) {
    const int n = z.n();
    const std::size_t s = static_cast<std::size_t>(z.stack);
    const double* block = p.qxx + k * s * n;
    double* row = value;
    for (int j = 0; j < z.count; ++j)
      for (int r = 0; r < n; ++r, block += n, row += s)
        for (int c = r; c < n; ++c) row[j * n + c] += block[c];
    if (p.state_diagonal)
      for (std::size_t i = 0; i < s; ++i) value[i * s + i] += p.state_diagonal[k * s + i];
    double* lower = value + s;
    for (std::size_t i = 1; i < s; ++i, lower += s) {
      const double* upper = value + i;
      for (std::size_t j = 0; j < i; ++j, upper += s) lower[j] = *upper;
    }
  }

  /// carried = p + P c; force = qu + b' carried
  static void gradients(const LqProblem& p, const LqFactor& f, const Sizes& z, std::size_t k, double* carried) {
    const std::size_t s = static_cast<std::size_t>(z.stack), m = static_cast<std::size_t>(z.m());
    const Product drift = {p.c ? p.c + k * s : nullptr, 0, 1, f.value + (k + 1) * s * s, s, z.stack};
    multiply(&drift, p.c ? 1 : 0, 0, 1, 0, z.stack, f.slope + (k + 1) * s, 0, carried, 0);
    const Product push = {carried, 0, 1, p.b + k * s * m, m, z.stack};
    multiply(&push, 1, 0, 1, 0, z.m(), p.qu + k * m, 0, f.force + k * m, 0);
  }
  /// slope = qx + a' carried + carry' step, once the step is known
  static void slope(const LqProblem& p, const LqFactor& f, const Sizes& z, std::size_t k, const double* carried) {
    const std::size_t s = static_cast<std::size_t>(z.stack), m = static_cast<std::size_t>(z.m()),
                      n = static_cast<std::size_t>(z.n());
    for (int j = 0; j < z.count; ++j) {
      const std::size_t at = static_cast<std::size_t>(j) * n;
      const Product sum[2] = {{carried + at, 0, 1, p.a + (k * s + at) * n, n, z.n()},
                              {f.step + k * m, 0, 1, f.carry + k * m * s + at, s, z.m()}};
      multiply(sum, 2, 0, 1, 0, z.n(), p.qx + k * s + at, 0, f.slope + k * s + at, 0);
    }
  }

  /// gain = -curvature^-1 carry
  static void gains(const LqFactor& f, const Sizes& z, std::size_t k) {
    const std::size_t s = static_cast<std::size_t>(z.stack), m = static_cast<std::size_t>(z.m());
    const std::int8_t* held = f.held ? f.held + k * m : nullptr;
    const double *l = f.cholesky + k * m * m, *carry = f.carry + k * m * s;
    double* gain = f.gain + k * m * s;
    if (z.stack >= kWidestPiece)
      solve_tiles<kWidestPiece>(z.m(), z.stack, held, l, carry, gain);
    else
      stage_gain(z.m(), z.stack, held, l, carry, gain);
  }

  static bool factorise(const LqProblem& p, const LqFactor& f) {
    const Sizes z(p);
    const std::size_t s = static_cast<std::size_t>(z.stack), horizon = p.stands_from ? p.stands_from : p.horizon;
    const std::size_t n = static_cast<std::size_t>(z.n()), m = static_cast<std::size_t>(z.m());
    double *pa = f.scratch, *pb = pa + s * s, *carried = pb + m * s;
    if (!p.stands_from) {
      set_blocks(p, z, horizon, f.value + horizon * s * s);
      copy(p.qx + horizon * s, z.stack, f.slope + horizon * s);
    }
    bool good = true;
    for (std::size_t k = horizon; k-- > 0;) {
      const double *a = p.a + k * s * n, *b = p.b + k * s * m, *ahead = f.value + (k + 1) * s * s;
      double *value = f.value + k * s * s, *curvature = f.curvature + k * m * m, *carry = f.carry + k * m * s;
      int live[TILLER_MAX_SCENARIOS];
      for (int j = 0; j < z.count; ++j) {
        const std::size_t at = static_cast<std::size_t>(j) * n;
        live[j] = kStates ? kStates : live_states(a + at * n, z.n());
        const Product onward = {ahead + at, s, 1, a + at * n, n, live[j]};
        multiply(&onward, 1, 0, z.stack, 0, live[j], nullptr, 0, pa + at, s);
        for (std::size_t r = 0; r < s && live[j] < z.n(); ++r)
          copy(nullptr, z.n() - live[j], pa + r * s + at + live[j]);
      }
      const Product crossed = {b, 1, m, pa, s, z.stack}, pulled = {b, 1, m, ahead, s, z.stack};
      multiply(&crossed, 1, 0, z.m(), 0, z.stack, p.qux ? p.qux + k * m * s : nullptr, s, carry, s);
      multiply(&pulled, 1, 0, z.m(), 0, z.stack, nullptr, 0, pb, s);
      const Product bent = {pb, s, 1, b, m, z.stack};
      multiply(&bent, 1, 0, z.m(), 0, z.m(), p.quu + k * m * m, m, curvature, m);
      for (std::size_t v = 0; v < m; ++v)
        curvature[v * m + v] += p.regularisation + (p.input_diagonal ? p.input_diagonal[k * m + v] : 0.0);
      gradients(p, f, z, k, carried);
      good &= cholesky_free(z.m(), f.held ? f.held + k * m : nullptr, curvature, f.cholesky + k * m * m);
      stage_step(z.m(), p, f, k, curvature, f.force + k * m, f.step + k * m);
      gains(f, z, k);
      slope(p, f, z, k, carried);
      for (int j = 0; j < z.count; ++j) {
        const std::size_t at = static_cast<std::size_t>(j) * n;
        const Product sum[2] = {{carry + at, 1, s, f.gain + k * m * s, s, z.m()},
                                {a + at * n, 1, n, pa + at * s, s, live[j]}};
        // from the diagonal on, rounded down to where tiles begin: the other half is its image
        for (int first = 0; first < z.n(); first += 8)
          multiply(sum, first < live[j] ? 2 : 1, first, first + 8 < z.n() ? first + 8 : z.n(),
                   (static_cast<int>(at) + first) / 8 * 8, z.stack, nullptr, 0, value + at * s, s);
      }
      add_blocks(p, z, k, value);
    }
    return good;
  }

  static void resolve(const LqProblem& p, const LqFactor& f) {
    const Sizes z(p);
    const std::size_t s = static_cast<std::size_t>(z.stack), horizon = p.horizon;
    const int m = z.m();
    copy(p.qx + horizon * s, z.stack, f.slope + horizon * s);
    for (std::size_t k = horizon; k-- > 0;) {
      gradients(p, f, z, k, f.scratch);
      stage_step(m, p, f, k, f.curvature + k * m * m, f.force + k * m, f.step + k * m);
      slope(p, f, z, k, f.scratch);
    }
  }

  static void roll(const LqProblem& p, const LqFactor& f, double* x, double* u) {
    const Sizes z(p);
    const std::size_t s = static_cast<std::size_t>(z.stack);
    const int n = z.n(), m = z.m();
    for (std::size_t k = 0; k < p.horizon; ++k) {
      const double *at = x + k * s, *input = u + k * m;
      for (int i = 0; i < m; ++i) {
        const std::size_t row = k * m + i;
        u[row] = f.step[row] + inner(f.gain + row * s, at, z.stack);
      }
      for (int j = 0; j < z.count; ++j)
        for (int r = 0; r < n; ++r) {
          const std::size_t row = k * s + static_cast<std::size_t>(j * n + r);
          x[row + s] = (p.c ? p.c[row] : 0.0) + inner(p.a + row * n, at + j * n, n) + inner(p.b + row * m, input, m);
        }
    }
  }
  /// Four sums side by side, which do not wait for each other; whole registers where only run time knows the length: a
  /// loop of nine or three turns is guessed wrong at its end.
  static TILLER_INLINE double inner(const double* a, const double* b, int count) {
    int i = 0;
    if constexpr (kStates == 0) {
      using Pack = Row<kWidestPiece>;
      Pack wide = Pack::zero();
      for (; i + kWidestPiece <= count; i += kWidestPiece) wide.v += Pack::load(a + i).v * Pack::load(b + i).v;
      double lane[kWidestPiece], rest = 0.0;
      wide.store(lane);
      for (; i < count; ++i) rest += a[i] * b[i];
      for (int half = kWidestPiece / 2; half > 0; half /= 2)
        for (int j = 0; j < half; ++j) lane[j] += lane[j + half];
      return lane[0] + rest;
    }
    double sum[4] = {};
    for (; i + 4 <= count; i += 4)
      for (int c = 0; c < 4; ++c) sum[c] += a[i + c] * b[i + c];
    for (; i < count; ++i) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
  }

  static void multipliers(const LqProblem& p, const LqFactor& f, const double* x, double* lambda) {
    const Sizes z(p);
    const std::size_t s = static_cast<std::size_t>(z.stack);
    for (std::size_t k = 0; k <= p.horizon; ++k) {
      const Product bent = {x + k * s, 0, 1, f.value + k * s * s, s, z.stack};
      multiply(&bent, 1, 0, 1, 0, z.stack, f.slope + k * s, 0, lambda + k * s, 0);
    }
  }

  static constexpr LqKernel kernel() {
    return {static_cast<std::uint32_t>(kStates),
            static_cast<std::uint32_t>(kInputs),
            &factorise,
            &resolve,
            &roll,
            &multipliers};
  }
};

}  // namespace lq

TILLER_ISA_NAMESPACE_END
