#pragma once

#include <cstdint>

#include "posterior/discrepancy_basis.hpp"

namespace tiller {

/// A force that wanders colours the residuals of the states that it pushes: e_k = b_k' beta + xi_k with
/// xi_k = rho xi_k-1 + white, a first-order autoregression (Cochrane and Orcutt 1949; Prais and Winsten 1954 for the
/// start of a run). rho is one of these, each pushed state's its own, and is summed over in closed form: a half of the
/// prior is for no colour, so that a still world costs little width. The steps from one to the next about halve what
/// is left to one.
constexpr std::uint32_t kColours = 7;
constexpr double kColour[kColours] = {0.0, 0.5, 0.75, 0.9, 0.95, 0.98, 0.995};
constexpr double kColourPrior[kColours] = {0.5, 1.0 / 12, 1.0 / 12, 1.0 / 12, 1.0 / 12, 1.0 / 12, 1.0 / 12};

/// Every quadratic sum over whitened residuals is q(rho) = q0 - rho q1 + rho^2 q2, where with the predecessor e-
///
///   q0 = sum w e e,  q1 = sum w (e e- + e- e),  q2 = sum w e- e-
///
/// and a transition without a predecessor, the start of a run, has q1 = 0 and q2 = -w e e: its variance is that of the
/// stationary process. So three sums stand for every rho.
constexpr std::uint32_t kLags = 3;

}  // namespace tiller
