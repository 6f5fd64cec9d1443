#pragma once

#include <vector>

#include <Eigen/Core>

#include "tools/gap/fit/shooting.hpp"

namespace tiller::tools::gap {

/// Deviations of the free parameters of a fit that was asked for `information`; zeros without it. The larger of two,
/// parameter by parameter:
///   - Gauss-Newton's, H^-1, times `fit.dispersion`: right where the noise is as the robot file says;
///   - the sandwich H^-1 (sum of g g' over windows + prior) H^-1 with each window's own gradient g (Huber 1967, White
///     1982, Maximum likelihood estimation of misspecified models; n / (n - d) for the d parameters that were fitted):
///     right where residuals are correlated within windows or larger in some than in others.
std::vector<double> deviations(const Hypothesis& hypothesis, const Fit& fit);

/// The covariance of the free parameters behind them: Gauss-Newton's, scaled to these deviations.
Eigen::MatrixXd covariance(const Hypothesis& hypothesis, const Fit& fit);

/// Standard deviation that a parameter's prior and bounds allow: data that say little widen neither.
double widest_sd(const FreeParam& param, double mean);

/// Half width of a 95 % interval in deviations: Student's t, since the windows tell the deviation too.
double interval_factor(const Hypothesis& hypothesis, const Fit& fit);

}  // namespace tiller::tools::gap
