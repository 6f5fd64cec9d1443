#pragma once

#include <cstdint>

#include "posterior/posterior.hpp"

namespace tiller {

/// How much the data have narrowed each direction: with the prior's covariance P and the particles' C, both in
/// coordinates, the pairs C x = r P x. A ratio r near one is a direction of which nothing was learnt (posterior
/// contraction; Schad, Betancourt and Vasishth, "Toward a principled Bayesian workflow", 2021).
struct Contraction {
  std::uint32_t d = 0;
  double variance_ratio[TILLER_MAX_PARAMS] = {};                 // (d) largest first
  double direction[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS] = {};  // (d x d) row i in units of each coordinate's prior
                                                                 // deviation, length one, largest entry positive
};

/// Eigenvectors of symmetric a (d x d, row-major) by cyclic Jacobi rotations (Golub and Van Loan, section 8.5): a's
/// diagonal becomes the eigenvalues, v's columns the vectors. Sweeps until the rest is rounding, at most kSweeps; d <=
/// TILLER_MAX_PARAMS. Cost: about 6 sweeps of 6 d^3.
void jacobi_eigen(std::uint32_t d, double* a, double* v);

/// Of the particles' weighted covariance `posterior` (d x d) against `prior` (d x d, positive definite). False where
/// either is not finite or the prior has no width.
bool contract(std::uint32_t d, const double* posterior, const double* prior, Contraction& to);

/// Of a posterior's particles under its configuration. Cost: O(N d^2 + d^3).
bool contract(const tiller_config_t& config, const Posterior& posterior, Contraction& to);

}  // namespace tiller
