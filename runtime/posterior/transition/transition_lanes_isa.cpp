// Sums of residuals and the evidence, one particle per lane. Compiled once per instruction set.

#include "posterior/transition/transition_lanes.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace {

using P = Pack<double>;
using F = Pack<float>;

/// rows[0 ..] += sums, in double.
void add(double* rows, const F& sums) {
  alignas(64) float all[F::width];
  sums.store(all);
  for (int l = 0; l < F::width; ++l) rows[l] += static_cast<double>(all[l]);
}

void sum_squares(const ResidualSumJob& job, std::uint32_t row, std::uint32_t lane) {
  F squared(0.0f);
  for (std::uint32_t k = 0; k < job.steps; ++k) {
    const float w = job.weight[k * job.nx + row];
    if (!(w > 0.0f)) continue;
    const F e = F::load(job.residual + (k * job.nx + row) * job.lanes + lane);
    squared = fma(e * F(w), e, squared);
  }
  add(job.sums + row * job.stride + lane, squared);
}

/// Squares and projections of a joint's velocity, in one pass.
void sum_joint(const ResidualSumJob& job, std::uint32_t joint, std::uint32_t lane) {
  const std::uint32_t row = job.velocity[joint], columns = job.joints * kDiscrepancyBasis;
  F squared(0.0f), projected[kDiscrepancyBasis] = {F(0.0f), F(0.0f), F(0.0f)};
  for (std::uint32_t k = 0; k < job.steps; ++k) {
    const float w = job.weight[k * job.nx + row];
    if (!(w > 0.0f)) continue;
    const float* basis = job.basis + k * columns + joint * kDiscrepancyBasis;
    const F e = F::load(job.residual + (k * job.nx + row) * job.lanes + lane), weighted = e * F(w);
    squared = fma(weighted, e, squared);
    for (std::uint32_t i = 0; i < kDiscrepancyBasis; ++i) projected[i] = fma(weighted, F(basis[i]), projected[i]);
  }
  add(job.sums + row * job.stride + lane, squared);
  for (std::uint32_t i = 0; i < kDiscrepancyBasis; ++i)
    add(job.sums + (job.nx + joint * kDiscrepancyBasis + i) * job.stride + lane, projected[i]);
}

void sum_residuals(const ResidualSumJob& job) {
  for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(F::width)) {
    for (std::uint32_t row = 0; row < job.nx; ++row) {
      bool of_joint = false;
      for (std::uint32_t j = 0; j < job.joints; ++j) of_joint = of_joint || job.velocity[j] == row;
      if (!of_joint) sum_squares(job, row, lane);
    }
    for (std::uint32_t j = 0; j < job.joints; ++j) sum_joint(job, j, lane);
  }
}

/// S_r / (2 b_r), less what the discrepancy takes up.
P scaled_error(const EvidenceJob& job, std::uint32_t row, std::uint32_t lane) {
  P squared = P::load(job.sums + row * job.stride + lane);
  const std::uint32_t joint = job.joint_of[row];
  if (joint < job.joints) {
    const double* m = job.shrinkage + joint * kDiscrepancyTriangle;
    const double* rows = job.sums + (job.nx + joint * kDiscrepancyBasis) * job.stride + lane;
    const P a = P::load(rows), b = P::load(rows + job.stride), c = P::load(rows + 2 * job.stride);
    const P ma = fma(P(m[0]), a, fma(P(2.0 * m[1]), b, P(2.0 * m[2]) * c));
    const P mb = fma(P(m[3]), b, P(2.0 * m[4]) * c);
    squared = squared - fma(a, ma, fma(b, mb, c * c * P(m[5])));
  }
  // rounding leaves a little less than nothing; much less, and an approximate past has been left behind
  const P scaled = P(job.half_precision[row]) * squared;
  return select(scaled < P(0.0), select(scaled < P(-1.0), P(__builtin_nan("")), P(0.0)), scaled);
}

void evidence(const EvidenceJob& job) {
  for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
    P total(0.0), product(1.0);
    for (std::uint32_t row = 0; row < job.nx; ++row) {
      product = product * (P(1.0) + scaled_error(job, row, lane));
      // one logarithm for all rows of the same count: factors are one or more, and far from overflow
      if (row + 1 < job.nx && job.exponent[row + 1] == job.exponent[row] && row % 4 != 3) continue;
      total = total - P(job.exponent[row]) * log(product);
      product = P(1.0);
    }
    total.store(job.log_likelihood + lane);
  }
}

void add_scaled(std::uint32_t n, double factor, const double* from, double* to) {
  const P scale(factor);
  for (std::uint32_t i = 0; i < n; i += static_cast<std::uint32_t>(P::width))
    fma(scale, P::load(from + i), P::load(to + i)).store(to + i);
}

}  // namespace

const TransitionTable& transition_copy() {
  static const TransitionTable table = {Isa::TILLER_COMPILE_ISA, sum_residuals, evidence, add_scaled};
  return table;
}

TILLER_ISA_NAMESPACE_END
