#pragma once

// The same sweeps for M systems under one input sequence, and for sizes that only run time knows (n or m is 0). The
// value function couples the systems through the shared input, so it is a full matrix of M x M blocks; the dynamics are
// block-diagonal, so a stage costs 2 M^2 n^3 products and not (M n)^3.

#include "rollout/lq_row.hpp"
#include "rollout/lq_stage.hpp"

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

  /// w entries of a sum of rows, in registers: out += sum_k s[k stride] rows[k pitch ...]. Two chains: half the
  /// latency.
  template <int w>
  static TILLER_INLINE void add_piece(const double* s, std::size_t stride, const double* rows, std::size_t pitch,
                                      int count, double* out) {
    Row<w> even = Row<w>::load(out), odd = Row<w>::zero();
    int k = 0;
    for (; k + 1 < count; k += 2, s += 2 * stride, rows += 2 * pitch) {
      even.add(s[0], Row<w>::load(rows));
      odd.add(s[stride], Row<w>::load(rows + pitch));
    }
    if (k < count) even.add(s[0], Row<w>::load(rows));
    even.add(odd);
    even.store(out);
  }
  /// The same for entries from..width of the rows, wide pieces first.
  static void add_rows(const double* s, std::size_t stride, const double* rows, std::size_t pitch, int count, int width,
                       double* out, int from = 0) {
    int j = from;
    for (; j + 16 <= width; j += 16) add_piece<16>(s, stride, rows + j, pitch, count, out + j);
    if (j + 8 <= width) add_piece<8>(s, stride, rows + j, pitch, count, out + j), j += 8;
    if (j + 4 <= width) add_piece<4>(s, stride, rows + j, pitch, count, out + j), j += 4;
    if (j + 2 <= width) add_piece<2>(s, stride, rows + j, pitch, count, out + j), j += 2;
    if (j < width) add_piece<1>(s, stride, rows + j, pitch, count, out + j);
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

  /// out (rows of n) = for each scenario j, in_j a_j
  static TILLER_INLINE void times_blocks(const double* in, const double* a, const Sizes& z, double* out) {
    const int n = z.n();
    for (int j = 0; j < z.count; ++j) {
      double* row = out + j * n;
      copy(nullptr, n, row);
      add_rows(in + j * n, 1, a + j * n * n, n, n, n, row);
    }
  }

  /// carried = p + P c; force = qu + b' carried
  static void gradients(const LqProblem& p, const LqFactor& f, const Sizes& z, std::size_t k, double* carried) {
    const std::size_t s = static_cast<std::size_t>(z.stack);
    const int m = z.m();
    copy(f.slope + (k + 1) * s, z.stack, carried);
    if (p.c) add_rows(p.c + k * s, 1, f.value + (k + 1) * s * s, s, z.stack, z.stack, carried);
    double* force = f.force + k * m;
    copy(p.qu + k * m, m, force);
    add_rows(carried, 1, p.b + k * s * m, m, z.stack, m, force);
  }
  /// slope = qx + a' carried + carry' step, once the step is known
  static void slope(const LqProblem& p, const LqFactor& f, const Sizes& z, std::size_t k, const double* carried) {
    const std::size_t s = static_cast<std::size_t>(z.stack);
    const int m = z.m(), n = z.n();
    double* out = f.slope + k * s;
    copy(p.qx + k * s, z.stack, out);
    for (int j = 0; j < z.count; ++j)
      add_rows(carried + j * n, 1, p.a + (k * s + static_cast<std::size_t>(j * n)) * n, n, n, n, out + j * n);
    add_rows(f.step + k * m, 1, f.carry + k * m * s, s, m, z.stack, out);
  }

  static bool factorise(const LqProblem& p, const LqFactor& f) {
    const Sizes z(p);
    const std::size_t s = static_cast<std::size_t>(z.stack), horizon = p.stands_from ? p.stands_from : p.horizon;
    const int n = z.n(), m = z.m();
    double *pa = f.scratch, *pb = pa + s * s, *carried = pb + static_cast<std::size_t>(m) * s;
    if (!p.stands_from) {
      set_blocks(p, z, horizon, f.value + horizon * s * s);
      copy(p.qx + horizon * s, z.stack, f.slope + horizon * s);
    }
    bool good = true;
    for (std::size_t k = horizon; k-- > 0;) {
      const double *a = p.a + k * s * n, *b = p.b + k * s * m, *ahead = f.value + (k + 1) * s * s;
      double *value = f.value + k * s * s, *curvature = f.curvature + k * m * m, *carry = f.carry + k * m * s;
      for (std::size_t i = 0; i < s; ++i) times_blocks(ahead + i * s, a, z, pa + i * s);
      copy(p.qux ? p.qux + k * m * s : nullptr, m * z.stack, carry);
      copy(nullptr, m * z.stack, pb);
      for (int v = 0; v < m; ++v) {
        add_rows(b + v, m, pa, s, z.stack, z.stack, carry + v * s);
        add_rows(b + v, m, ahead, s, z.stack, z.stack, pb + v * s);
      }
      copy(p.quu + k * m * m, m * m, curvature);
      for (int v = 0; v < m; ++v) {
        add_rows(pb + v * s, 1, b, m, z.stack, m, curvature + v * m);
        curvature[v * m + v] += p.regularisation + (p.input_diagonal ? p.input_diagonal[k * m + v] : 0.0);
      }
      gradients(p, f, z, k, carried);
      const std::int8_t* held = f.held ? f.held + k * m : nullptr;
      good &= cholesky_free(m, held, curvature, f.cholesky + k * m * m);
      stage_step(m, p, f, k, curvature, f.force + k * m, f.step + k * m);
      stage_gain(m, z.stack, held, f.cholesky + k * m * m, carry, f.gain + k * m * s);
      slope(p, f, z, k, carried);
      set_blocks(p, z, k, value);
      for (int j = 0; j < z.count; ++j)
        for (int r = 0; r < n; ++r) {
          // from the diagonal on, rounded down to where registers begin: the other triangle is its image
          const int at = j * n + r, from = at / 8 * 8;
          double* row = value + at * s;
          add_rows(a + j * n * n + r, n, pa + j * n * s, s, n, z.stack, row, from);
          add_rows(carry + at, s, f.gain + k * m * s, s, m, z.stack, row, from);
        }
      for (std::size_t i = 1; i < s; ++i)
        for (std::size_t j = 0; j < i; ++j) value[i * s + j] = value[j * s + i];
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
        double sum = f.step[k * m + i];
        for (std::size_t j = 0; j < s; ++j) sum += f.gain[(k * m + i) * s + j] * at[j];
        u[k * m + i] = sum;
      }
      for (int j = 0; j < z.count; ++j)
        for (int r = 0; r < n; ++r) {
          const std::size_t row = k * s + static_cast<std::size_t>(j * n + r);
          double sum = p.c ? p.c[row] : 0.0;
          for (int q = 0; q < n; ++q) sum += p.a[row * n + q] * at[j * n + q];
          for (int i = 0; i < m; ++i) sum += p.b[row * m + i] * input[i];
          x[row + s] = sum;
        }
    }
  }

  static void multipliers(const LqProblem& p, const LqFactor& f, const double* x, double* lambda) {
    const Sizes z(p);
    const std::size_t s = static_cast<std::size_t>(z.stack);
    for (std::size_t k = 0; k <= p.horizon; ++k) {
      copy(f.slope + k * s, z.stack, lambda + k * s);
      add_rows(x + k * s, 1, f.value + k * s * s, s, z.stack, z.stack, lambda + k * s);
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
