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

/// q1 and q2 of one pushed state (`squares`: of its squares too) and of one joint's forces, from column `at` on.
void sum_coloured(const ResidualSumJob& job, std::uint32_t place, std::uint32_t at, bool squares, std::uint32_t lane) {
  const std::uint32_t columns = job.pushed_count * job.regressors, kind = job.pushed_count + columns;
  const std::uint32_t row = job.pushed[place], first = job.nx + columns;
  F square[2] = {F(0.0f), F(0.0f)}, projected[2][kDiscrepancyBasis];
  for (auto& lag : projected)
    for (F& sums : lag) sums = F(0.0f);
  for (std::uint32_t k = 0; k < job.steps; ++k) {
    const float w = job.weight[k * job.nx + row];
    if (!(w > 0.0f)) continue;
    const float* from = job.residual + (k * job.nx + row) * job.lanes + lane;
    const F e = F::load(from) * F(w);
    const float* b = job.basis + k * columns + at;
    if (!(job.linked[k * job.pushed_count + place] > 0.0f)) {
      square[1] = square[1] - e * F::load(from);
      for (std::uint32_t c = 0; c < kDiscrepancyBasis; ++c) projected[1][c] = fma(e, F(-b[c]), projected[1][c]);
      continue;
    }
    const F before = F::load(from - job.nx * job.lanes) * F(w);
    const float* b_before = k > 0 ? b - columns : job.basis_before + at;
    square[0] = fma(e + e, F::load(from - job.nx * job.lanes), square[0]);
    square[1] = fma(before, F::load(from - job.nx * job.lanes), square[1]);
    for (std::uint32_t c = 0; c < kDiscrepancyBasis; ++c) {
      projected[0][c] = fma(e, F(b_before[c]), fma(before, F(b[c]), projected[0][c]));
      projected[1][c] = fma(before, F(b_before[c]), projected[1][c]);
    }
  }
  for (std::uint32_t lag = 0; lag < 2; ++lag) {
    double* to = job.sums + (first + lag * kind) * job.stride + lane;
    if (squares) add(to + place * job.stride, square[lag]);
    for (std::uint32_t c = 0; c < kDiscrepancyBasis; ++c)
      add(to + (job.pushed_count + at + c) * job.stride, projected[lag][c]);
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
      for (lane = 0; moves && lane < job.lanes; lane += kWidth) sum_coloured(job, place, at, first == 0, lane);
    }
  }
}

/// q0 - rho q1 + rho^2 q2 of the rows of one sum.
P at_colour(const double* q0, const double* q1, const double* q2, double rho) {
  return fma(P(rho * rho), P::load(q2), fma(P(-rho), P::load(q1), P::load(q0)));
}

/// S_r / (2 b_r). Rounding leaves a little less than nothing; much less, and an approximate past has been left behind.
P scaled(const EvidenceJob& job, std::uint32_t row, const P& squared) {
  const P error = P(job.half_precision[row]) * squared;
  return select(error < P(0.0), select(error < P(-1.0), P(__builtin_nan("")), P(0.0)), error);
}

/// Of a pushed state at one rho, less what the discrepancy takes up.
P coloured_error(const EvidenceJob& job, std::uint32_t row, std::uint32_t lane, std::uint32_t colour) {
  const std::uint32_t place = job.pushed_of[row], regressors = job.regressors, columns = job.pushed_count * regressors;
  const std::size_t kind = std::size_t{job.pushed_count + columns} * job.stride;
  const double* plain = job.sums + lane;
  const double* lagged = plain + std::size_t{job.nx + columns} * job.stride;
  const double rho = kColour[colour];
  P p[kMaxRegressors];
  for (std::uint32_t i = 0; i < regressors; ++i) {
    const std::size_t at = std::size_t{place * regressors + i};
    const double* q1 = lagged + (job.pushed_count + at) * job.stride;
    p[i] = at_colour(plain + (job.nx + at) * job.stride, q1, q1 + kind, rho);
  }
  const double* q1 = lagged + std::size_t{place} * job.stride;
  const P squared = at_colour(plain + std::size_t{row} * job.stride, q1, q1 + kind, rho);
  const double* shrinkage = job.shrinkage + (place * kColours + colour) * upper_triangle(regressors);
  return scaled(job, row, squared - quadratic_form(shrinkage, p, regressors));
}

/// log sum over rho of weight (1 + S / (2 b))^-exponent.
P coloured_evidence(const EvidenceJob& job, std::uint32_t row, std::uint32_t lane) {
  const double* log_weight = job.log_weight + job.pushed_of[row] * kColours;
  P logs[kColours], top(-__builtin_huge_val()), broken(0.0);
  for (std::uint32_t c = 0; c < kColours; ++c) {
    logs[c] = P(log_weight[c]) - P(job.exponent[row]) * log(P(1.0) + coloured_error(job, row, lane, c));
    broken = broken + (logs[c] - logs[c]);  // NOLINT(misc-redundant-expression): NaN where not finite
    top = max(logs[c], top);
  }
  const P lowest(-700.0);
  P sum(0.0);
  for (const P& one : logs) sum = sum + exp(max(one - top, lowest));
  // NaN of one rho is NaN of all: max() may have dropped it
  return top + log(sum) + broken;
}

bool is_pushed(const EvidenceJob& job, std::uint32_t row) { return job.pushed_of[row] < job.pushed_count; }

P scaled_error(const EvidenceJob& job, std::uint32_t row, std::uint32_t lane) {
  if (is_pushed(job, row)) return coloured_error(job, row, lane, job.lead[job.pushed_of[row]]);
  return scaled(job, row, P::load(job.sums + row * job.stride + lane));
}

void evidence(const EvidenceJob& job) {
  for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
    P total(0.0), product(1.0);
    for (std::uint32_t row = 0; row < job.nx; ++row) {
      if (is_pushed(job, row)) {
        total = total + coloured_evidence(job, row, lane);
        continue;
      }
      product = product * (P(1.0) + scaled_error(job, row, lane));
      // one logarithm for all rows of the same count: factors are one or more, and far from overflow
      const bool joins = row + 1 < job.nx && !is_pushed(job, row + 1) && job.exponent[row + 1] == job.exponent[row];
      if (joins && row % 4 != 3) continue;
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
