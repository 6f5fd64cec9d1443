#pragma once

#include <cstddef>
#include <cstdint>

#include "core/arena.hpp"
#include "scalar/isa.hpp"

namespace tiller {

/// A linear-quadratic problem over N stages (`horizon`), for deviations x (n) and u (m):
///
///     minimise  sum_{k<N} 1/2 [x;u]' [qxx qux'; qux quu] [x;u] + qx'x + qu'u   +   1/2 x_N' qxx_N x_N + qx_N' x_N
///     subject to  x_{k+1} = a x_k + b u_k + c,  x_0 given,  and, where low is set, low <= u_k <= high
///
/// Every array is stage-major, contiguous, row-major: entry (r, s) of stage k's a is a[(k * n + r) * n + s]. qxx is
/// symmetric (both triangles are read), the Hessian positive semi-definite, quu positive definite once what is added to
/// its diagonal is in.
///
/// With scenarios M > 1, M systems of n states run under one input sequence: a, b, c, qxx, qx have a row of M
/// blocks a stage (a: N x M x n x n; qxx, qx: (N+1) x M x ...; qux: m rows of M n), quu and qu stay one; the state is
/// the M n stacked ones.
/// Weights of the scenarios are the caller's to multiply in.
struct LqProblem {
  std::uint32_t states = 0;     // n
  std::uint32_t inputs = 0;     // m
  std::uint32_t horizon = 0;    // N
  std::uint32_t scenarios = 1;  // M
  const double* a = nullptr;    // (N x M x n x n)
  const double* b = nullptr;    // (N x M x n x m)
  const double* c = nullptr;    // (N x M x n); null: zero
  const double* qxx = nullptr;  // (N+1 x M x n x n)
  const double* qux = nullptr;  // (N x m x M n); null: zero
  const double* quu = nullptr;  // (N x m x m)
  const double* qx = nullptr;   // (N+1 x M x n)
  const double* qu = nullptr;   // (N x m)
  // Added to the diagonals of qxx and quu where they are used: what a barrier or a penalty changes from one
  // factorisation to the next. Null: nothing.
  const double* state_diagonal = nullptr;  // (N+1 x M x n)
  const double* input_diagonal = nullptr;  // (N x m)
  double regularisation = 0.0;             // and to all of quu's diagonal: a proximal term 1/2 r |u|^2
  // Stages from here on stand in the factor as they are (same matrices, vectors and held inputs): factorise does the
  // ones before alone. 0: all are done.
  std::uint32_t stands_from = 0;
  const double* low = nullptr;   // (N x m), read where `held` is set
  const double* high = nullptr;  // (N x m)
};

/// The result of a factorisation. The caller owns the arrays (lay_out_lq_factor); s = M n.
///
///     u_k = gain x_k + step            (note the sign: the gain is added)
///     cost to go = 1/2 x' value x + slope' x + constant, so the multiplier of x_{k+1} = f is value x + slope there
///
/// Repeated use. `factorise` reads everything and fills everything. `resolve` takes the same matrices with other c, qx,
/// qu (and the same held inputs): it reads value, gain, cholesky, carry and curvature and fills slope,
/// force and step alone, at the price of matrix-vector products. For changed diagonals call `factorise` again.
struct LqFactor {
  double* gain = nullptr;       // (N x m x s)
  double* step = nullptr;       // (N x m)
  double* cholesky = nullptr;   // (N x m x m) lower L, L L' = curvature of the free inputs; its diagonal is inverted
  double* carry = nullptr;      // (N x m x s) d2 cost / du dx, the future included
  double* value = nullptr;      // (N+1 x s x s)
  double* slope = nullptr;      // (N+1 x s)
  double* curvature = nullptr;  // (N x m x m) d2 cost / du2
  double* force = nullptr;      // (N x m) so that d cost / du = carry x + curvature u + force
  std::int8_t* held = nullptr;  // (N x m) -1 at low, 1 at high, 0 free; the caller's to set. Null: all free
  double* scratch = nullptr;    // lq_scratch_size doubles; read and written by every call
};

std::size_t lq_scratch_size(std::uint32_t states, std::uint32_t inputs, std::uint32_t scenarios);

/// Takes the arrays from the arena; `box` takes `held` too.
LqFactor lay_out_lq_factor(Arena& arena, const LqProblem& sizes, bool box);

/// The sweeps for one size of problem on one instruction set.
struct LqKernel {
  std::uint32_t states = 0, inputs = 0;  // 0: any
  /// Backward: gains, value function, gradient. False where the inputs' curvature is not positive definite (raise
  /// `regularisation`) or something is not finite; the factor is then unusable. Cost for n=4, m=1: about 25 ns a stage.
  bool (*factorise)(const LqProblem& problem, const LqFactor& factor) = nullptr;
  /// Backward, other right-hand sides on the same factor.
  void (*resolve)(const LqProblem& problem, const LqFactor& factor) = nullptr;
  /// Forward: x (N+1 x s), whose first row is given, and u (N x m).
  void (*roll)(const LqProblem& problem, const LqFactor& factor, double* x, double* u) = nullptr;
  /// lambda (N+1 x s) = value x + slope: multipliers of the dynamics, row k+1 for stage k.
  void (*multipliers)(const LqProblem& problem, const LqFactor& factor, const double* x, double* lambda) = nullptr;
};

struct RolloutTable;

/// The kernel for M scenarios of n states and m inputs: one of the table's fixed sizes (the model's (nx, nu) and
/// (nx + nu, nu) for M = 1, (nx, nu) for more), or the general one.
const LqKernel& select_lq(const RolloutTable& table, std::uint32_t states, std::uint32_t inputs,
                          std::uint32_t scenarios = 1);
/// Without a model, M = 1: fixed for 12 states and 4 inputs, else general.
const LqKernel& select_lq(Isa isa, std::uint32_t states, std::uint32_t inputs);

/// The exact minimum under the box, by a primal-dual active set: solve with some inputs held at their bounds, hold what
/// went beyond, let go what pulls back (Hintermueller, Ito, Kunisch 2002: a semi-smooth Newton method). Starts from
/// factor.held. Returns the sweeps made, 0 where factorise failed. After `most_sweeps` without agreement x, u are the
/// last sweep's, and inputs that were free may be beyond the box; `exact` tells. `factorised`: the first sweep's factor
/// stands already.
std::uint32_t solve_lq_box(const LqKernel& kernel, const LqProblem& problem, const LqFactor& factor, double* x,
                           double* u, std::uint32_t most_sweeps, bool* exact, bool factorised = false);

}  // namespace tiller
