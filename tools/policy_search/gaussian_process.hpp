#pragma once

#include "tools/policy_search/gp_moments.hpp"

namespace tiller::tools::policy {

/// How well known a Gaussian process's shape is: of each output length scales, signal and noise, as logarithms.
struct GpShape {
  Matrix log_length;             ///< (inputs x outputs)
  Vector log_signal, log_noise;  ///< (outputs) standard deviations

  bool empty() const { return log_signal.size() == 0; }
};

struct GpOptions {
  int most_points = 150;    ///< more data are told by so many inducing points (FITC)
  int most_fitted = 250;    ///< data that the shape is fitted to; of more, a random part
  int evaluations = 80;     ///< of the marginal likelihood, for each output
  double most_ratio = 500;  ///< of signal to noise, softly
};

/// Negative logarithm of the marginal likelihood of targets y (n) at x (inputs x n), a squared exponential kernel with
/// a length scale for each input and white noise (Rasmussen and Williams 2006, equation 5.8), its gradient with respect
/// to p = (log lengths, log signal, log noise). Cost: O(n^3).
double gp_evidence(const Matrix& x, const Vector& y, const Vector& p, Vector* gradient);

/// Fits the shape to y (outputs x n) at x (inputs x n) by the marginal likelihood, from `shape` where it is not empty.
/// Signal-to-noise ratios over `most_ratio` and length scales beyond a hundred deviations of the inputs are fined.
void fit_shape(const Matrix& x, const Matrix& y, const GpOptions& options, std::uint64_t seed, GpShape& shape);

/// The process given data: exact up to `most_points`, else by inducing points taken from the data where the variance is
/// largest (pivoted Cholesky) in the FITC approximation (Snelson and Ghahramani 2006).
Bumps condition(const Matrix& x, const Matrix& y, const GpShape& shape, const GpOptions& options);

}  // namespace tiller::tools::policy
