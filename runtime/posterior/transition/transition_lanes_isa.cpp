// Sums of residuals and the evidence, one particle per lane. Compiled once per instruction set.

#include "posterior/lane_forms.hpp"
#include "posterior/transition/transition_lanes.hpp"

#include "posterior/transition/proposal_lanes_isa.hpp"
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

/// One state over kPacks registers of lanes at once, so that their chains of additions overlap: its squares, and where
/// `basis` is not null its projections on the regressors of one joint's forces, to the rows from `projections` on;
/// without `squares` the projections alone.
template <int kPacks>
void sum_row(const ResidualSumJob& job, std::uint32_t row, std::uint32_t lane, bool squares, const float* basis,
             double* projections) {
  constexpr std::uint32_t kWidth = static_cast<std::uint32_t>(F::width);
  const std::uint32_t columns = job.pushed_count * job.regressors;
  F squared[kPacks], projected[kDiscrepancyBasis][kPacks];
  for (int i = 0; i < kPacks; ++i) {
    squared[i] = F(0.0f);
    for (auto& sums : projected) sums[i] = F(0.0f);
  }
  for (std::uint32_t k = 0; k < job.steps; ++k) {
    const float w = job.weight[k * job.nx + row];
    if (!(w > 0.0f)) continue;
    const float* from = job.residual + (k * job.nx + row) * job.lanes + lane;
    F e[kPacks];
    for (int i = 0; i < kPacks; ++i) {
      e[i] = F::load(from + static_cast<std::uint32_t>(i) * kWidth);
      squared[i] = fma(e[i] * F(w), e[i], squared[i]);
    }
    if (!basis) continue;
    const float* b = basis + k * columns;
    for (std::uint32_t c = 0; c < kDiscrepancyBasis; ++c)
      for (int i = 0; i < kPacks; ++i) projected[c][i] = fma(e[i], F(w * b[c]), projected[c][i]);
  }
  for (int i = 0; i < kPacks; ++i) {
    const std::uint32_t at = lane + static_cast<std::uint32_t>(i) * kWidth;
    if (squares) add(job.sums + row * job.stride + at, squared[i]);
    for (std::uint32_t c = 0; basis && c < kDiscrepancyBasis; ++c)
      add(projections + c * job.stride + at, projected[c][i]);
  }
}

void sum_residuals(const ResidualSumJob& job) {
  constexpr std::uint32_t kWidth = static_cast<std::uint32_t>(F::width);
  const std::uint32_t regressors = job.regressors;
  for (std::uint32_t row = 0; row < job.nx; ++row) {
    std::uint32_t place = 0;
    while (place < job.pushed_count && job.pushed[place] != row) ++place;
    const bool moves = place < job.pushed_count;
    for (std::uint32_t first = 0; first < (moves ? regressors : 1); first += kDiscrepancyBasis) {
      const std::uint32_t at = place * regressors + first;
      const float* basis = moves ? job.basis + at : nullptr;
      double* projections = moves ? job.sums + (job.nx + at) * job.stride : nullptr;
      std::uint32_t lane = 0;
      for (; lane + 4 * kWidth <= job.lanes; lane += 4 * kWidth)
        sum_row<4>(job, row, lane, first == 0, basis, projections);
      for (; lane < job.lanes; lane += kWidth) sum_row<1>(job, row, lane, first == 0, basis, projections);
    }
  }
}

/// S_r / (2 b_r), less what the discrepancy takes up.
P scaled_error(const EvidenceJob& job, std::uint32_t row, std::uint32_t lane) {
  P squared = P::load(job.sums + row * job.stride + lane);
  const std::uint32_t place = job.pushed_of[row];
  if (place < job.pushed_count) {
    const std::uint32_t regressors = job.regressors;
    P p[kMaxRegressors];
    for (std::uint32_t i = 0; i < regressors; ++i)
      p[i] = P::load(job.sums + (job.nx + place * regressors + i) * job.stride + lane);
    squared = squared - quadratic_form(job.shrinkage + place * upper_triangle(regressors), p, regressors);
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

bool mean_errors(const EvidenceJob& job, const double* weight, double* mean, double* before) {
  P total(0.0), left[TILLER_MAX_STATES], all[TILLER_MAX_STATES];
  for (std::uint32_t r = 0; r < job.nx; ++r) left[r] = all[r] = P(0.0);
  for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
    P error[TILLER_MAX_STATES], sum(0.0);
    for (std::uint32_t r = 0; r < job.nx; ++r) {
      error[r] = scaled_error(job, r, lane);
      sum = sum + error[r];
    }
    const auto counts = (sum - sum) == P(0.0);  // NOLINT(misc-redundant-expression): NaN where not finite
    const P w = select(counts, P::load(weight + lane), P(0.0));
    total = total + w;
    for (std::uint32_t r = 0; r < job.nx; ++r) {
      left[r] = fma(w, select(counts, error[r], P(0.0)), left[r]);
      all[r] = fma(w, select(counts, P::load(job.sums + r * job.stride + lane), P(0.0)), all[r]);
    }
  }
  const double sum = reduce_add(total);
  if (!(sum > 0.0)) return false;
  for (std::uint32_t r = 0; r < job.nx; ++r) {
    mean[r] = reduce_add(left[r]) / (sum * job.half_precision[r]);
    before[r] = reduce_add(all[r]) / sum;
  }
  return true;
}

bool split_weights(std::uint32_t n, const double* log_weight, const double* old, double exponent, const double* fresh,
                   double* base, double* gain) {
  auto all_finite = P(0.0) == P(0.0);
  for (std::uint32_t i = 0; i < n; i += static_cast<std::uint32_t>(P::width)) {
    const P l = P::load(log_weight + i), f = P::load(fresh + i), sum = l + f;
    const auto finite = (sum - sum) == P(0.0);  // NOLINT(misc-redundant-expression)
    select(finite, l - P(exponent) * P::load(old + i), P(-__builtin_huge_val())).store(base + i);
    select(finite, f, P(0.0)).store(gain + i);
    all_finite = all_finite & finite;
  }
  return !all(all_finite);
}

void normalise(std::uint32_t n, const double* base, const double* gain, double exponent, double sum, double log_sum,
               double* weight, double* log_weight) {
  for (std::uint32_t i = 0; i < n; i += static_cast<std::uint32_t>(P::width)) {
    (P::load(weight + i) * P(1.0 / sum)).store(weight + i);
    (fma(P(exponent), P::load(gain + i), P::load(base + i)) - P(log_sum)).store(log_weight + i);
  }
}

void find_broken(std::uint32_t n, std::uint32_t rows, const double* from, double* bad) {
  for (std::uint32_t i = 0; i < n; i += static_cast<std::uint32_t>(P::width)) {
    P sum(0.0);
    for (std::uint32_t r = 0; r < rows; ++r) sum = sum + P::load(from + r * n + i);
    (sum - sum).store(bad + i);  // NOLINT(misc-redundant-expression)
  }
}

void add_scaled(std::uint32_t n, double factor, const double* from, double* to) {
  const P scale(factor);
  for (std::uint32_t i = 0; i < n; i += static_cast<std::uint32_t>(P::width))
    fma(scale, P::load(from + i), P::load(to + i)).store(to + i);
}

}  // namespace

extern const TransitionTable kTransitionLanes;
const TransitionTable kTransitionLanes = {
    Isa::TILLER_COMPILE_ISA, sum_residuals, evidence,    mean_errors, propose_lanes,
    split_weights,           normalise,     find_broken, add_scaled};

TILLER_ISA_NAMESPACE_END
