#pragma once

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools {

/// What lets a log leave the model.
struct SmoothSettings {
  /// (nf) of the forces that the model lacks, a random walk each: N or N m per root second. Empty: no forces.
  Eigen::VectorXd force_sd;
  double process_scale = 1;  ///< times the configuration's process_sd
  double unlisted_sd = NAN;  ///< of a state that is logged without being a sensor of the robot's; NaN: it is not read
};

/// A grid as the model explains it, from the point on where its state is known: n columns, one a point.
struct SmoothedGrid {
  std::size_t first = 0;                  ///< the grid's point of the first column
  Eigen::MatrixXd state, state_variance;  ///< (nx x n)
  Eigen::MatrixXd filtered;               ///< (nx x n) from what was measured until then, as a controller knows it
  Eigen::MatrixXd force, force_variance;  ///< (nf x n) that the model lacks over the period that begins there
  double log_likelihood = 0;              ///< of the measurements, by the prediction errors
  double misfit = 0;  ///< RMS of the prediction errors in their own deviations; about 1 if the model fits
};

/// The one smoother of logs: an extended Kalman filter forward and the smoother of Rauch, Tung and Striebel (1965)
/// back, over the model's states and, if wanted, a force per joint. Sensors have the deviations and sensor effects of
/// `config`; encoders suffice. Delays read the grid's inputs before, and effects with states of their own go on from
/// the mean's. A reading that is missing is left out.
///
/// The filter begins at the first point where each state that has a sensor, and the position of each other velocity
/// that has one, is read. A state that nothing reads begins where [start] has it.
///
/// `params` (np of `config`): fixed. Slopes are central differences of rollouts in lanes; cost: points x (nx + nf)
/// rollouts of one period, and as many products of (nx + nf)-matrices. No column where no point begins the filter.
/// False with a sentence in `error`: no room for the forces among the effects, or the filter ran away (the model is
/// unusable at these parameters).
bool smooth_grid(const tiller_config_t& config, const std::vector<double>& params, const Grid& grid,
                 const SmoothSettings& settings, SmoothedGrid& out, std::string& error);

/// Of the measurements of all grids; minus infinity where smooth_grid() fails. A forward pass alone.
double filter_log_likelihood(const tiller_config_t& config, const std::vector<double>& params,
                             const std::vector<Grid>& grids, const SmoothSettings& settings);

}  // namespace tiller::tools
