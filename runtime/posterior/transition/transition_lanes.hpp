#pragma once

#include <cstdint>

#include "posterior/transition/proposal_lanes.hpp"
#include "scalar/isa.hpp"
#include "tiller/model.h"

namespace tiller {

/// Forces at one joint that the model may lack: constant, viscous, dry (force_response.hpp).
constexpr std::uint32_t kDiscrepancyBasis = 3;
/// Joints that have them; a model with more has them at its first ones alone.
constexpr std::uint32_t kDiscrepancyJoints = 4;
/// Regressors of one velocity: the forces at every such joint.
constexpr std::uint32_t kMaxRegressors = kDiscrepancyJoints * kDiscrepancyBasis;
/// Distinct elements of a symmetric matrix, row by row from the diagonal on: 00 01 02 .. 11 12 ..
constexpr std::uint32_t upper_triangle(std::uint32_t size) { return size * (size + 1) / 2; }

/// Sums of squares and of projections from residuals. Rows of `sums`: nx squares sum_k w_kr e_kr^2, then for joint j
/// its projections sum_k w_kr b_kji e_kr, r the joint's velocity, at nx + j * regressors + i; regressors = joints *
/// kDiscrepancyBasis.
struct ResidualSumJob {
  std::uint32_t nx = 0, joints = 0;
  std::uint32_t lanes = 0;                         // a multiple of 16, the residual's stride
  std::uint32_t steps = 0;                         // <= 64: they are summed in single precision
  std::uint32_t velocity[TILLER_MAX_JOINTS] = {};  // (joints) state that the basis of each joint acts on
  const float* residual = nullptr;                 // (steps * nx x lanes)
  const float* weight = nullptr;                   // (steps x nx) 0: missing, the residual is then not read
  const float* basis = nullptr;                    // (steps x joints * regressors)
  double* sums = nullptr;                          // (rows) +=
  std::uint32_t stride = 0;
};

/// log L = -sum_r exponent_r log(1 + S_r / (2 b_r)), where a joint's velocity has S_r - p' M p in the place of S_r.
struct EvidenceJob {
  std::uint32_t nx = 0, joints = 0;
  std::uint32_t lanes = 0;                         // a multiple of 16
  std::uint32_t joint_of[TILLER_MAX_STATES] = {};  // (nx) joint whose velocity the state is; `joints` for none
  double half_precision[TILLER_MAX_STATES] = {};   // (nx) 1 / (2 b_r)
  double exponent[TILLER_MAX_STATES] = {};         // (nx)
  const double* shrinkage = nullptr;               // (joints x upper_triangle(regressors)) M
  const double* sums = nullptr;                    // (rows), as above
  std::uint32_t stride = 0;
  double* log_likelihood = nullptr;  // (lanes) NaN where a sum is
};

/// Sums at many points from polynomials (residual_summary.hpp): of the squares phi' G_r phi, of the projections t_j' phi.
struct PolynomialJob {
  std::uint32_t d = 0, nx = 0, projections = 0;
  std::uint32_t terms = 0;
  bool quadratic = true;
  std::uint32_t lanes = 0;               // a multiple of 16
  const double* centre = nullptr;        // (d)
  const double* inverse_root = nullptr;  // (d x d) lower
  const double* gram = nullptr;          // (nx x terms (terms + 1) / 2)
  const double* tilt = nullptr;          // (projections x terms)
  double factor = 1.0;
  const double* coordinate = nullptr;  // (d), rows of `stride`
  double* sums = nullptr;              // (nx + projections) += factor * sum, rows of `stride`
  std::uint32_t stride = 0;
};
constexpr std::uint32_t kMaxPolynomialTerms = 28;  // six coordinates, second order

/// The loops over particles that are compiled per instruction set.
struct TransitionTable {
  Isa isa = Isa::scalar;
  void (*sum_residuals)(const ResidualSumJob& job) = nullptr;
  void (*evidence)(const EvidenceJob& job) = nullptr;
  /// mean[r] (nx) = sum_l weight_l S_lr over the lanes whose sums are finite and whose weight is not zero, divided by their
  /// weight; false where there is none. The discrepancy's share is taken off S; shares[r]: the same of S before.
  bool (*mean_errors)(const EvidenceJob& job, const double* weight, double* mean, double* before) = nullptr;
  void (*polynomial)(const PolynomialJob& job) = nullptr;
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
