#pragma once

// References of the calibration benchmark. They share no code with runtime/: an extended Kalman filter of their own
// over the plants' equations, importance sampling of the parameters, and a joint-state unscented filter.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "harness/calibration/calibration_plant.hpp"

namespace tiller::bench {

/// The marginal prior of one inferred parameter.
struct ReferencePrior {
  enum class Kind { uniform, normal, log_normal };
  Kind kind = Kind::uniform;
  double a = 0.0, b = 0.0;  ///< mean and deviation; of a log-normal: median, and deviation of the logarithm
  double low = -INFINITY, high = INFINITY;

  double log_density(double value) const;  ///< up to a constant; of the coordinate, the logarithm where log-normal
  double to_coordinate(double value) const;
  double from_coordinate(double coordinate) const;
  double mean() const;       ///< of the uncut law, in the coordinate
  double deviation() const;  ///< the same
};

/// The known quantities of a recording and the inferred ones.
struct ReferenceProblem {
  PlantPhysics physics;                 ///< the parameters that are not inferred; process_sd: nominal
  std::vector<int> inferred;            ///< indices of parameters
  std::vector<ReferencePrior> prior;    ///< (inferred)
  bool measured[kPlantStates] = {};     ///< states that are read
  double sensor_sd[kPlantStates] = {};  ///< nominal, quantisation included
  double start[kPlantStates] = {}, start_sd[kPlantStates] = {};
  /// False: the nominal noise is the truth. True: sigma^2 ~ InvGamma(shape, shape) scales all variances, and the
  /// process deviations are exp(ratio) times as large beside it, ratio ~ N(0, ratio_sd^2).
  bool noise_unknown = false;
  double noise_shape = 5.0, noise_ratio_sd = 1.5;

  int dimensions() const { return static_cast<int>(inferred.size()); }
  int unknowns() const { return dimensions() + (noise_unknown ? 2 : 0); }
};

/// Log likelihood of a recording under parameters (inferred, physical) and scales of the noise, by an extended Kalman
/// filter whose mean is integrated by RK4 and whose process noise is that of accelerations white in time.
double filter_log_likelihood(const ReferenceProblem& problem, const PlantRecord& record, const double* param,
                             double sensor_scale, double process_scale);

/// Weighted points of the posterior of the inferred parameters.
struct ReferencePosterior {
  Eigen::MatrixXd point;   ///< (d x n) physical
  Eigen::VectorXd weight;  ///< (n) sums to one
  double effective = 0.0;  ///< effective number of points

  Eigen::VectorXd mean() const { return point * weight; }
  Eigen::MatrixXd covariance() const;
  double rank(int j, double truth) const;  ///< weight below the truth
};

/// Importance sampling with Student-t proposals about the mode, twice refitted. `near` (d, physical) is where the
/// search for the mode begins: a reference may know the truth. Cost: about 2,000 likelihoods.
ReferencePosterior sample_reference(const ReferenceProblem& problem, const PlantRecord& record, const double* near,
                                    std::uint64_t seed);

/// Mean and covariance of the inferred parameters from an unscented Kalman filter over states and parameters jointly
/// (Julier and Uhlmann 1997; scaled, alpha = 1, kappa = 0), the nominal noise taken for true.
struct JointEstimate {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};
JointEstimate joint_unscented(const ReferenceProblem& problem, const PlantRecord& record);

}  // namespace tiller::bench
