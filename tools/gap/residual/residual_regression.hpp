#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <memory>
#include <vector>

#include "tiller/config.hpp"
#include "tools/gap/residual/prediction_error.hpp"

// The regression behind fit_residual(): a configuration's inferred parameters and the forces of its effect `residual`.

namespace tiller::tools::gap {

/// The regression for one set of widths: where it stands (`z`), what the logs say there (`sums`), and the prior of the
/// forces. Coordinates are those of the priors: the logarithm for a log-normal one.
class ResidualRegression {
 public:
  using Matrix = Eigen::MatrixXd;
  using Vector = Eigen::VectorXd;

  /// `params` (first): where the configuration's own parameters begin; the effect's stand from `first` on.
  ResidualRegression(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params,
                     std::uint32_t first);

  /// Forces ~ N(0, sd^2).
  void set_prior(double sd);
  double prior_sd() const { return 1.0 / std::sqrt(precision_(precision_.size() - 1)); }

  /// The logs' likelihood and its slope by the coordinates at z. One run of the filter.
  PredictionSums pass(const Vector& z, double force_sd) const;

  /// Parameters of z, and differences to take derivatives by.
  void at(const Vector& z, std::vector<double>& params, std::vector<double>& step) const;

  /// Gauss-Newton with the step halved until the objective falls; the prior's deviation chosen along the way unless
  /// `typical` is 0. False: the prediction errors have no bound.
  bool solve(double force_sd, double typical);

  /// The random force that is most likely at the present parameters, between `low` and `high`.
  double choose_force_sd(double low, double high) const;

  /// Laplace's approximation of the log marginal likelihood from the expansion at z.
  double evidence(const PredictionSums& at, const Vector& z) const;
  Matrix posterior_precision(const PredictionSums& at, double share = 1.0, double wider = 1.0) const;

  /// How wrong rollouts of a second from the filter's states are, and what they depend on: rows of error, variance
  /// that the state's doubt and the sensor leave, and slope along each parameter of z (d).
  struct Prediction {
    Vector error, variance;
    Matrix slope;
    double rms_sigma = HUGE_VAL;  ///< errors in the sensor's deviations
  };
  Prediction predict(const std::vector<Grid>& grids, double force_sd) const;

  const Vector& z() const { return z_; }
  const PredictionSums& sums() const { return sums_; }
  const std::vector<std::uint32_t>& free() const { return free_; }  ///< (d) inferred parameters, the forces last

 private:
  double penalty(const Vector& z) const { return 0.5 * (z - centre_).cwiseAbs2().dot(precision_); }
  double objective(const PredictionSums& s, const Vector& z) const {
    return s.finite ? penalty(z) - s.log_likelihood : HUGE_VAL;
  }
  void choose_prior(const PredictionSums& at, const Vector& z, double typical);
  Vector inside(Vector z) const;

  Config config_;
  std::vector<double> params_;
  std::vector<std::uint32_t> free_;
  std::size_t own_ = 0;  // parameters beside the forces
  Vector z_, centre_, precision_;
  PredictionSums sums_;
  std::unique_ptr<PredictionError> error_;
};

}  // namespace tiller::tools::gap
