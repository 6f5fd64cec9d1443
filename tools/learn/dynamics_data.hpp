#pragma once

#include <Eigen/Core>
#include <vector>

#include "tools/nets/standardise.hpp"
#include "tools/smooth/forces.hpp"

namespace tiller::tools::learn {

/// What a network of forces is trained on, in order one.
struct DynamicsData {
  Eigen::MatrixXd x;       ///< (inputs x n) as network_input_count() has them, standardised
  Eigen::MatrixXd y;       ///< (nf x n) forces, standardised
  Eigen::MatrixXd weight;  ///< (nf x n) inverse variances, of mean one over each row's samples that count
  std::vector<int> block;  ///< (n) stretches of half a second: what is drawn, and held out, together
  nets::Standardiser in, out;
};

/// Inputs of a network of forces (network_input_count x n) at states (nx x n) and inputs (nu x n), in the order of
/// rollout/step.hpp.
Eigen::MatrixXd network_features(const tiller_model_t& model, const Eigen::MatrixXd& state,
                                 const Eigen::MatrixXd& input);

/// Of smoothed forces, to which `known` (nf x n), what a network had already said there, is added.
DynamicsData make_dynamics_data(const tiller_config_t& config, const SmoothedForces& forces,
                                const Eigen::MatrixXd& known);

}  // namespace tiller::tools::learn
