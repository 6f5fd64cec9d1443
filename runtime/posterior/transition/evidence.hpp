#pragma once

#include <cstddef>
#include <cstdint>

#include "posterior/transition/transition_lanes.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The likelihood of one-step residuals whose noise scale and whose linear discrepancy are integrated out, per state r:
///
///   e_kr(theta) = b_k' beta_r + xi_kr,  xi_kr = rho_r xi_k-1,r + noise,  noise ~ N(0, s_r^2)
///   beta_r ~ N(0, s_r^2 K),  s_r^2 ~ InvGamma(a0, b_r),  rho_r one of kColour; 0 of a state that no force pushes
///   log L = -sum_r (a0 + n_r / 2) log(b_r + (S_r - p_r' (B_r + K^-1)^-1 p_r) / 2)
///
/// with S_r = sum w e^2, p_r = sum w b e, B_r = sum w b b', n_r = sum w: the normal-inverse-gamma family (Bernardo and
/// Smith, Bayesian Theory, 1994, appendix A.2). Of a rho they are those of the whitened residuals e_k - rho e_k-1 and
/// regressors, q0 - rho q1 + rho^2 q2 (colour.hpp), and L sums over rho:
///
///   L_r = sum_rho prior |B + K^-1|^-1/2 (1 - rho^2)^(starts / 2) L_r(rho)
///
/// The determinant at rho = 0 does not depend on theta: it is left out of L and counts in log_constant() alone.
///
/// b_r = a0 (q_r^2 dt + 2 m_r^2) with the configured process_sd q and measurement_sd m.
class Evidence {
 public:
  Evidence() = default;
  explicit Evidence(const tiller_config_t& config);
  /// Matrices (matrix_count()) stand there from now on; before anything is counted. Calls clear().
  void use(double* matrices);
  std::size_t matrix_count() const {
    return std::size_t{kLags + kColours} * pushed_count_ * upper_triangle(regressors());
  }

  void clear();
  /// The noise's law before the data: a0 and b from here on. As configured, or as worth `values` values of `variance`
  /// (nx). Call before clear().
  void believe_configuration();
  void believe(const double* variance, double values);
  void forget(double keep);
  /// One transition: weight (nx), 0 for missing rows; linked (pushed_count), 1 where the transition before is its
  /// predecessor, whose regressors are `before`.
  struct Counted {
    const float* weight = nullptr;
    const float* basis = nullptr;   // (columns)
    const float* linked = nullptr;  // (pushed_count)
    const float* before = nullptr;  // (columns)
  };
  void count(const Counted& one);
  /// M = (B + K^-1)^-1 of each pushed state and rho; call after count().
  void prepare();
  /// The discrepancy's share of count() alone, times `sign`.
  void add_basis(const Counted& one, double sign);
  /// Which rho says most of a state, by the particles of `weight`: the one that what follows is taken at.
  void lead(std::uint32_t lanes, const double* sums, std::uint32_t stride, const double* weight, std::uint32_t step);
  double colour(std::uint32_t row) const { return place_of(row) < pushed_count_ ? kColour[lead_[place_of(row)]] : 0.0; }

  std::uint32_t nx() const { return nx_; }
  /// Joints at which the discrepancy's forces act.
  std::uint32_t joints() const { return joints_; }
  /// States that they push: the velocities of those joints, then their positions.
  std::uint32_t pushed_count() const { return pushed_count_; }
  std::uint32_t pushed(std::uint32_t place) const { return pushed_[place]; }
  std::uint32_t joint_of(std::uint32_t place) const { return pushed_joint_[place]; }
  /// Place of a state among them; pushed_count() for none.
  std::uint32_t place_of(std::uint32_t row) const { return pushed_of_[row]; }
  /// Of one pushed state, and of all of them.
  std::uint32_t regressors() const { return joints_ * kDiscrepancyBasis; }
  std::uint32_t columns() const { return pushed_count_ * regressors(); }
  std::uint32_t rows() const { return nx_ + columns() + (kLags - 1) * lagged_rows(); }
  /// Of q1, and of q2.
  std::uint32_t lagged_rows() const { return pushed_count_ + columns(); }
  double known(std::uint32_t row) const { return known_[row]; }

  /// Of `lanes` particles whose sums stand in rows of `stride`.
  void log_likelihood(std::uint32_t lanes, const double* sums, std::uint32_t stride, double* out) const;
  /// The part that is equal for every particle: log of the evidence less log L, whose change is a transition's share.
  double log_constant() const;
  /// Weighted means (nx) of the squared error and of what it is with the discrepancy's share; false where no particle
  /// is finite.
  bool mean_errors(std::uint32_t lanes, const double* sums, std::uint32_t stride, const double* weight, double* left,
                   double* before) const;
  /// Of one particle, sums (rows) at `stride`.
  double squared_error(const double* sums, std::uint32_t stride, std::uint32_t row) const;
  /// E[beta | p] (regressors) of one pushed state.
  void coefficients(const double* sums, std::uint32_t stride, std::uint32_t place, double* beta) const;
  /// The part of a new residual, or of a whitened one, that the discrepancy does not explain: e - b' E[beta | p].
  double innovation(const double* sums, std::uint32_t stride, std::uint32_t row, double residual,
                    const float* basis) const;
  /// Student-t predictive of one residual: degrees of freedom, and the square of its scale (b' M b included).
  double freedom(std::uint32_t row) const { return 2.0 * exponent(row); }
  double scale_square(const double* sums, std::uint32_t stride, std::uint32_t row, const float* basis) const;
  /// E[s_r^2]
  double noise_variance(double squared_error, std::uint32_t row) const;
  double configured_variance(std::uint32_t row) const { return configured_[row]; }

 private:
  const double* shrinkage(std::uint32_t place, std::uint32_t colour) const {
    return shrinkage_ + (place * kColours + colour) * upper_triangle(regressors());
  }
  double* information(std::uint32_t lag, std::uint32_t place) {
    return information_ + (lag * pushed_count_ + place) * upper_triangle(regressors());
  }
  double at_colour(const double* sums, std::uint32_t stride, std::uint32_t plain, std::uint32_t lagged,
                   double rho) const;
  double squared_error(const double* sums, std::uint32_t stride, std::uint32_t place, std::uint32_t colour) const;
  void projections(const double* sums, std::uint32_t stride, std::uint32_t place, std::uint32_t colour,
                   double* p) const;
  EvidenceJob job(std::uint32_t lanes, const double* sums, std::uint32_t stride) const;
  double exponent(std::uint32_t row) const { return a0_ + 0.5 * known_[row]; }

  std::uint32_t nx_ = 0, joints_ = 0, pushed_count_ = 0;
  std::uint32_t pushed_[kMaxPushed] = {}, pushed_joint_[kMaxPushed] = {};
  std::uint32_t pushed_of_[TILLER_MAX_STATES] = {};
  double a0_ = 1.0, configured_a0_ = 1.0;
  double configured_[TILLER_MAX_STATES] = {};  // variances
  double b_[TILLER_MAX_STATES] = {};
  double known_[TILLER_MAX_STATES] = {};
  double starts_[kMaxPushed] = {};                 // weight of transitions not linked
  double* information_ = nullptr;                  // (kLags x pushed_count x triangle) B as q0, q1, q2
  double* shrinkage_ = nullptr;                    // (pushed_count x kColours x triangle) M
  double log_determinant_[kMaxPushed] = {};        // of B + K^-1 at rho = 0
  double log_weight_[kMaxPushed * kColours] = {};  // beside L(rho); of rho = 0 the prior's
  std::uint32_t lead_[kMaxPushed] = {};
};

}  // namespace tiller
