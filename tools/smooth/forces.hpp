#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools {

/// Periods whose forces still hang on the filter's beginning.
constexpr Eigen::Index kForceBegins = 10;

/// Periods of logs with what a model lacks there: smoothed states, and forces with their variance.
struct SmoothedForces {
  Eigen::MatrixXd state;       ///< (nx x n) at a period's beginning
  Eigen::MatrixXd filtered;    ///< (nx x n) the same from what was measured until then, as a controller knows it
  Eigen::MatrixXd input;       ///< (nu x n) over it
  Eigen::MatrixXd force;       ///< (nf x n) that the model lacks over it
  Eigen::MatrixXd variance;    ///< (nf x n)
  std::vector<double> weight;  ///< (n) 1, or 0 where the smoother had only begun
};

/// All grids by smooth_grid() with a force of intensity force_sd (nf) at every joint. False with a sentence in `error`
/// where that fails, and where no grid begins.
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

}  // namespace tiller::tools
