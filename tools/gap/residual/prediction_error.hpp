#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <vector>

#include "rollout/rollout.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Log likelihood of logs under a model, by the innovations of an extended Kalman filter, and its Gauss-Newton
/// expansion in parameters: e(z + dz) = e - S dz, with S from the filter run on the state's derivatives (Ljung 1999,
/// System Identification, chapter 7; the gains' own dependence on z is left out).
struct PredictionSums {
  bool finite = false;
  double log_likelihood = 0;
  double squared = 0;           ///< normalised innovations
  double count = 0;             ///< values taken in
  Eigen::VectorXd gradient;     ///< (d) of the log likelihood
  Eigen::MatrixXd information;  ///< (d x d)
  Eigen::VectorXd response;     ///< (nx) root mean square change of the state over a period for a unit force
};

/// The state of the filter at a point of a log.
struct Filtered {
  std::size_t grid = 0, point = 0;
  Eigen::VectorXd state;       ///< (nx)
  Eigen::MatrixXd covariance;  ///< (nx x nx)
};

/// Runs over all stretches. Memory is fixed by the constructor; a pass costs one linearised step a point.
class PredictionError {
 public:
  /// `free`: indices of the parameters that z holds. `force_parts`: those whose joint unit change is a unit force at
  /// a joint (the weights of a partition of unity), the directions of the process noise.
  PredictionError(const tiller_config_t& config, const std::vector<Grid>& grids, std::vector<std::uint32_t> free,
                  std::vector<std::uint32_t> force_parts);

  /// `params` (np); `step` (d): differences to take derivatives by; `force_sd`: deviation of a random force that is
  /// constant over each period, besides config.process_sd.
  PredictionSums run(const std::vector<double>& params, const std::vector<double>& step, double force_sd);
  /// The same pass, for what the filter knows at every `every`-th point from a second after a stretch's start on.
  std::vector<Filtered> filter(const std::vector<double>& params, const std::vector<double>& step, double force_sd,
                               std::size_t every);

 private:
  struct Start {
    std::size_t point;
    Eigen::VectorXd state, sd;
  };
  bool advance(const Grid& grid, std::size_t point, double force_sd);
  void correct(const Grid& grid, std::size_t point, PredictionSums& sums);

  const tiller_config_t& config_;
  const tiller_model_t& model_;
  const std::vector<Grid>& grids_;
  std::vector<std::uint32_t> free_, force_parts_;
  const RolloutTable& table_;
  StepSetup setup_;
  std::uint32_t lanes_;
  std::vector<std::vector<Start>> starts_;  // at most one a grid
  std::vector<double> params_, step_, next_, a_, effect_state_, next_effect_, history_;
  Eigen::VectorXd x_, push_, response_;
  std::vector<Filtered>* kept_ = nullptr;
  std::size_t every_ = 1;
  Eigen::MatrixXd p_, s_;  // covariance (nx x nx), derivative of the state (nx x d)
};

}  // namespace tiller::tools::gap
