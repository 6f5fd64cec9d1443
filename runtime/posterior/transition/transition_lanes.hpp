#pragma once

#include <cstdint>

#include "posterior/discrepancy_basis.hpp"
#include "posterior/packed_matrix.hpp"
#include "posterior/transition/colour.hpp"
#include "posterior/transition/proposal_lanes.hpp"
#include "scalar/isa.hpp"
#include "tiller/model.h"

namespace tiller {

/// Sums of squares and of projections from residuals. Rows of `sums`: nx squares sum_k w_kr e_kr^2, then for each
/// pushed state r = pushed[b] its projections sum_k w_kr b_kbi e_kr at nx + b * regressors + i. Then twice, for q1 and
/// q2 of colour.hpp, a row for each pushed state's squares and one for each projection.
struct ResidualSumJob {
  std::uint32_t nx = 0, regressors = 0;
  std::uint32_t pushed_count = 0;
  std::uint32_t pushed[kMaxPushed] = {};  // states that the regressors act on
  std::uint32_t lanes = 0;                // a multiple of 16, the residual's stride
  std::uint32_t steps = 0;                // <= 64: they are summed in single precision
  const float* residual = nullptr;        // (steps * nx x lanes)
  const float* weight = nullptr;          // (steps x nx) 0: missing, the residual is then not read
  const float* basis = nullptr;           // (steps x pushed_count * regressors)
  const float* linked = nullptr;          // (steps x pushed_count) 1: the step before counts as its predecessor; else 0
  // of the step before the first, read where that is linked: nx rows of lanes before `residual`, and
  const float* basis_before = nullptr;  // (pushed_count * regressors)
  double* sums = nullptr;               // (rows) +=
  std::uint32_t stride = 0;
};

/// log L = -sum_r exponent_r log(1 + S_r / (2 b_r)). A pushed state has S - p' M p in the place of S_r, both of a rho,
/// and the logarithm of a sum over these.
struct EvidenceJob {
  std::uint32_t nx = 0, regressors = 0, pushed_count = 0;
  std::uint32_t lanes = 0;                          // a multiple of 16
  std::uint32_t pushed_of[TILLER_MAX_STATES] = {};  // (nx) place among the pushed states; pushed_count for none
  double half_precision[TILLER_MAX_STATES] = {};    // (nx) 1 / (2 b_r)
  double exponent[TILLER_MAX_STATES] = {};          // (nx)
  const double* shrinkage = nullptr;                // (pushed_count x kColours x upper_triangle(regressors)) M
  const std::uint32_t* lead = nullptr;              // (pushed_count) the rho at which mean_errors() is taken
  const double* log_weight = nullptr;               // (pushed_count x kColours) what does not depend on the particle
  const double* sums = nullptr;                     // (rows), as above
  std::uint32_t stride = 0;
  double* log_likelihood = nullptr;  // (lanes) NaN where a sum is
};

/// The loops over particles that are compiled per instruction set.
struct TransitionTable {
  Isa isa = Isa::scalar;
  void (*sum_residuals)(const ResidualSumJob& job) = nullptr;
  void (*evidence)(const EvidenceJob& job) = nullptr;
  /// mean[r] (nx) = sum_l weight_l S_lr over the lanes whose sums are finite and whose weight is not zero, divided by
  /// their weight; false where there is none. The discrepancy's share is taken off S; shares[r]: the same of S before.
  bool (*mean_errors)(const EvidenceJob& job, const double* weight, double* mean, double* before) = nullptr;
  ProposeLanes propose = nullptr;
  /// base = log_weight - exponent * old and gain = fresh; where one of them is not finite, -infinity and 0. True if any
  /// is not.
  bool (*split_weights)(std::uint32_t n, const double* log_weight, const double* old, double exponent,
                        const double* fresh, double* base, double* gain) = nullptr;
  /// weight *= 1 / sum, log_weight = base + exponent * gain - log_sum.
  void (*normalise)(std::uint32_t n, const double* base, const double* gain, double exponent, double sum,
                    double log_sum, double* weight, double* log_weight) = nullptr;
  /// flags sum_r rows[r * n + i] that is not finite: bad[i] = NaN, else 0. n a multiple of 16
  void (*find_broken)(std::uint32_t n, std::uint32_t rows, const double* from, double* bad) = nullptr;
  /// to += factor * from, n a multiple of 16
  void (*add_scaled)(std::uint32_t n, double factor, const double* from, double* to) = nullptr;
};

/// The copy for this processor (best_isa).
const TransitionTable& transition_table();

}  // namespace tiller
