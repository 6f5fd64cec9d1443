#pragma once

#include "tools/policy_search/gp_moments.hpp"
#include "tools/policy_search/var_matrix.hpp"

namespace tiller::tools::policy {

/// x and, behind it, sine and cosine of each of its `angles`: exact first two moments. Sine and cosine of a normal
/// angle are characteristic functions: E sin = exp(-s/2) sin m, and products are halves of cosines of sums. The
/// covariance of x_j and sin x_i is S_ji E cos x_i (Stein's lemma).
VarNormal with_sines(const VarNormal& x, const std::vector<int>& angles);

/// u_i = middle_i + half_i (9 sin v_i + sin 3 v_i) / 8: never beyond middle +- half, and flat at its ends (Deisenroth
/// and Rasmussen 2011, section 3.3). Exact moments; the gain is diag(E du_i/dv_i), by Stein's lemma.
VarMoments squashed(const VarMatrix& mean, const VarMatrix& covariance, const Vector& low, const Vector& high);
double squash(double v, double low, double high);

/// E[1 - exp(-1/2 (z - target)' W (z - target))] of a normal z; W symmetric, positive semidefinite.
Var saturating_cost(Tape& tape, const VarNormal& z, const Vector& target, const Matrix& weight);
double saturating_cost(const Vector& z, const Vector& target, const Matrix& weight);

/// bump_moments on the tape. `derivative`, if not null, takes what the sweep finds of the bumps; it and the bumps
/// outlive the sweep.
VarMoments taped_bumps(Tape& tape, const Bumps& bumps, const VarNormal& input, BumpsDerivative* derivative);

}  // namespace tiller::tools::policy
