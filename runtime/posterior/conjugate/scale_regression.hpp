#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Bayesian linear regression with an unknown noise scale:
///
///     y = x' w + e,   w ~ N(0, I),   e ~ N(0, s^2),   s^2 ~ InvGamma(a0, a0),   w and s^2 independent
///
/// (the prior of w does not widen with the noise, as it would in the conjugate normal-inverse-gamma law: what the data
/// do not identify keeps its own width). Given s the posterior of w is normal in closed form; s is the one number left,
/// and is integrated over a grid of kNodes values of t = log s^2, by the trapezoidal rule, which for such functions
/// converges exponentially (Trefethen and Weideman, SIAM Review 2014): exact to rounding from a few data on.
///
/// Data are kept as the triangular factor R of [X y], updated by Givens rotations (Golub and Van Loan, section 5.1.8):
/// R'R cannot lose its definiteness, whatever the number of data. Its singular values and vectors (one-sided Jacobi,
/// same book, section 8.6.3) make every node cost O(d). Cost: add O(d^2), solve O(d^3 + kNodes d^2).
class ScaleRegression {
 public:
  static constexpr std::uint32_t kMax = TILLER_MAX_PARAMS, kNodes = 48;

  void reset(std::uint32_t d, double a0);
  /// Keeps the share `rate` of the data's weight.
  void forget(double rate);
  /// One datum: x (d), finite.
  void add(const double* x, double y);
  /// The posterior of what has been added. Everything below is of the last solve (after reset: of the prior).
  void solve();

  std::uint32_t dimension() const { return d_; }
  double count() const { return count_; }        // data, less what is forgotten
  double variance() const { return variance_; }  // E[s^2]
  const double* mean() const { return mean_; }   // (d) of w
  double covariance(std::uint32_t r, std::uint32_t c) const { return covariance_[r][c]; }

  /// Given node k's s: the law of a' w is normal. Its mean and variance; node_weight() sums to one.
  double node_weight(std::uint32_t k) const { return weight_[k]; }
  void along(const double* a, std::uint32_t k, double* mean, double* variance) const;
  /// Given node k's s: w = mean + root z with z ~ N(0, I), root the symmetric one (d x d, stride kMax): a smooth
  /// function of the data.
  void law(std::uint32_t k, double* mean, double* root) const;

 private:
  void decompose();
  void find_range(double* low, double* high) const;
  double log_density(double t) const;
  void take_moments();
  double shrunk(std::uint32_t i, double s2) const { return s2 / (s2 + value_[i] * value_[i]); }  // of a prior variance

  std::uint32_t d_ = 0;
  double a0_ = 1.0, count_ = 0.0;
  double root_[kMax + 1][kMax + 1];  // R, upper triangular; column d: y
  // R's first d rows and columns are U diag(value) V'
  double value_[kMax], along_[kMax];  // along: U' y
  double vector_[kMax][kMax];         // V, its columns
  double rest_ = 0.0;                 // squares of y that no w takes up
  double node_[kNodes], weight_[kNodes];
  double mean_[kMax], covariance_[kMax][kMax], variance_ = 1.0;
};

}  // namespace tiller
