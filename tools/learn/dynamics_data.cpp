#include "tools/learn/dynamics_data.hpp"

#include <cmath>

#include "rollout/rollout.hpp"

namespace tiller::tools::learn {
namespace {

constexpr double kBlock_s = 0.5;

/// Mean and deviation that count the samples by weight.
nets::Standardiser weighted_standard(const Eigen::MatrixXd& y, const std::vector<double>& weight) {
  std::vector<Eigen::Index> taken;
  for (std::size_t k = 0; k < weight.size(); ++k)
    if (weight[k] > 0.0) taken.push_back(static_cast<Eigen::Index>(k));
  Eigen::MatrixXd some(y.rows(), static_cast<Eigen::Index>(taken.size()));
  for (std::size_t k = 0; k < taken.size(); ++k) some.col(static_cast<Eigen::Index>(k)) = y.col(taken[k]);
  return nets::Standardiser::of(taken.empty() ? y : some);
}

}  // namespace

Eigen::MatrixXd network_features(const tiller_model_t& model, const Eigen::MatrixXd& state,
                                 const Eigen::MatrixXd& input) {
  Eigen::MatrixXd x(network_input_count(model), state.cols());
  Eigen::Index row = 0;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const tiller_joint_t& joint = model.joints[j];
    if (joint.position != TILLER_NO_POSITION) {
      if ((model.angle_mask >> joint.position) & 1u) {
        x.row(row++) = state.row(joint.position).array().sin();
        x.row(row++) = state.row(joint.position).array().cos();
      } else {
        x.row(row++) = state.row(joint.position);
      }
    }
    x.row(row++) = state.row(joint.velocity);
  }
  x.bottomRows(model.input_count) = input;
  return x;
}

DynamicsData make_dynamics_data(const tiller_config_t& config, const SmoothedForces& forces,
                                const Eigen::MatrixXd& known) {
  DynamicsData d;
  const Eigen::MatrixXd x = network_features(*config.model, forces.state, forces.input);
  const Eigen::MatrixXd y = forces.force + known;
  d.in = weighted_standard(x, forces.weight);
  d.out = weighted_standard(y, forces.weight);
  d.out.mean.setZero();  // no force where nothing was learnt
  d.x = d.in.apply(x);
  d.y = d.out.apply(y);
  d.weight.resize(y.rows(), y.cols());
  const auto length = static_cast<Eigen::Index>(std::max(1.0, std::round(kBlock_s / config.period_s)));
  for (Eigen::Index k = 0; k < y.cols(); ++k) d.block.push_back(static_cast<int>(k / length));
  for (Eigen::Index j = 0; j < y.rows(); ++j) {
    // a force is never known better than to a hundredth of what it is at large
    const double least = 1e-4 * d.out.sd(j) * d.out.sd(j);
    double sum = 0.0, count = 0.0;
    for (Eigen::Index k = 0; k < y.cols(); ++k) {
      const bool counts = forces.weight[static_cast<std::size_t>(k)] > 0.0;
      d.weight(j, k) = counts ? 1.0 / (forces.variance(j, k) + least) : 0.0;
      sum += d.weight(j, k);
      count += counts;
    }
    if (sum > 0.0) d.weight.row(j) *= count / sum;
  }
  return d;
}

}  // namespace tiller::tools::learn
