#pragma once

#include <cstdint>

#include "scalar/isa.hpp"
#include "tiller/model.h"

namespace tiller {

/// Regressors of the discrepancy of one joint: 1, v, tanh(v / v0).
constexpr std::uint32_t kDiscrepancyBasis = 3;
/// Distinct elements of a symmetric matrix of that size: 00 01 02 11 12 22.
constexpr std::uint32_t kDiscrepancyTriangle = 6;

/// Sums of squares and of projections from residuals. Rows of `sums`: nx squares sum_k w_kr e_kr^2, then for joint j
/// its projections sum_k w_kr b_kji e_kr, r the joint's velocity, at nx + j * kDiscrepancyBasis + i.
struct ResidualSumJob {
  std::uint32_t nx = 0, joints = 0;
  std::uint32_t lanes = 0;                         // a multiple of 16, the residual's stride
  std::uint32_t steps = 0;                         // <= 64: they are summed in single precision
  std::uint32_t velocity[TILLER_MAX_JOINTS] = {};  // (joints) state that the basis of each joint acts on
  const float* residual = nullptr;                 // (steps * nx x lanes)
  const float* weight = nullptr;                   // (steps x nx) 0: missing, the residual is then not read
  const float* basis = nullptr;                    // (steps x joints * kDiscrepancyBasis)
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
  const double* shrinkage = nullptr;               // (joints x kDiscrepancyTriangle) M
  const double* sums = nullptr;                    // (rows), as above
  std::uint32_t stride = 0;
  double* log_likelihood = nullptr;  // (lanes) NaN where a sum is
};

/// The loops over particles that are compiled per instruction set.
struct TransitionTable {
  Isa isa = Isa::scalar;
  void (*sum_residuals)(const ResidualSumJob& job) = nullptr;
  void (*evidence)(const EvidenceJob& job) = nullptr;
  /// to += factor * from, n a multiple of 16
  void (*add_scaled)(std::uint32_t n, double factor, const double* from, double* to) = nullptr;
};

/// The copy for this processor (best_isa).
const TransitionTable& transition_table();

}  // namespace tiller
