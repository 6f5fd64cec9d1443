#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

/// The configuration with a constant force at every joint, whose values are its last parameters. False with a sentence
/// in `error` where there is no room for them among effects and parameters.
bool with_forces(const tiller_config_t& config, Config& out, std::string& error);

/// One period of the model, with its slopes along the state and along the forces of with_forces(): central differences
/// of rollouts in lanes. Effects' own states go on from the middle lane's.
class ForcedStep {
 public:
  /// `config`: with forces or without; it outlives the object. `params`: of the configuration without forces.
  /// `force_step` (nf, or none): half the width of the forces' differences, N or N m.
  ForcedStep(const tiller_config_t& config, const std::vector<double>& params, const Eigen::VectorXd& force_step);

  void begin(const Grid& grid, std::size_t point);
  /// z (nx + nf): next (nx), slope (nx x (nx + nf)). False where a value is not finite. Cost: 2 (nx + nf) + 1 rollouts
  /// of a period.
  bool run(const Grid& grid, std::size_t point, const Eigen::VectorXd& z, Eigen::VectorXd& next,
           Eigen::MatrixXd& slope);

 private:
  double step_of(std::uint32_t i, double value) const;

  std::uint32_t nx_, nf_, np_;
  const tiller_model_t& model_;
  GridRollout rollout_;
  Eigen::VectorXd force_step_;
  std::vector<double> state_, next_, effect_, effect_next_;
};

}  // namespace tiller::tools
