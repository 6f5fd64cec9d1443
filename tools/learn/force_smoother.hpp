#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::learn {

/// Periods of logs with what a model lacks there: smoothed states, and forces with their variance.
struct SmoothedForces {
  Eigen::MatrixXd state;       ///< (nx x n) at a period's beginning
  Eigen::MatrixXd filtered;    ///< (nx x n) the same from what was measured until then, as a controller knows it
  Eigen::MatrixXd input;       ///< (nu x n) over it
  Eigen::MatrixXd force;       ///< (nf x n) that the model lacks over it
  Eigen::MatrixXd variance;    ///< (nf x n)
  std::vector<double> weight;  ///< (n) 1, or 0 where the smoother had only begun
  double log_likelihood = 0;   ///< of the measurements, by the prediction errors
};

/// The model with one unknown force per joint, a random walk of intensity force_sd(j) (N or N m per root second), under
/// an extended Kalman filter and the smoother of Rauch, Tung and Striebel (1965) through every grid. Encoders suffice.
/// Slopes are central differences of rollouts in lanes; cost: points x (nx + nf) rollouts of one period, and as many
/// products of (nx + nf)-matrices.
///
/// `params` (np of `config`): fixed. False with a sentence in `error`: no room for the forces among the effects, or the
/// filter ran away (the model is unusable at these parameters).
bool smooth_forces(const tiller_config_t& config, const std::vector<Grid>& grids, const std::vector<double>& params,
                   const Eigen::VectorXd& force_sd, SmoothedForces& out, std::string& error);

/// A force at each joint (nf) that accelerates it as the logs show: the root mean square of its acceleration over what
/// a unit force makes of it. Zeros where a joint never moves.
Eigen::VectorXd typical_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                               const std::vector<double>& params);

/// The intensity (nf) of the largest likelihood, which goes to `log_likelihood` unless it is null: one factor for all
/// joints, then each joint's own.
Eigen::VectorXd choose_force_sd(const tiller_config_t& config, const std::vector<Grid>& grids,
                                const std::vector<double>& params, const Eigen::VectorXd& typical,
                                double* log_likelihood = nullptr);

/// The configuration with the sensors' deviations times the factor, of 1, 2, 4 and 8, that makes the logs likeliest
/// beside forces that walk: spikes and steps of an encoder would else be forces. `force_sd` is set to the intensity
/// there.
Config with_honest_sensors(const tiller_config_t& config, const std::vector<Grid>& grids,
                           const std::vector<double>& params, const Eigen::VectorXd& typical,
                           Eigen::VectorXd& force_sd);

}  // namespace tiller::tools::learn
