#include "rollout/state_spread.hpp"

#include <algorithm>

namespace tiller {

void fill_process_covariance(const tiller_model_t& model, const double* sd, double period_s, double* covariance) {
  const std::uint32_t nx = model.state_count;
  std::fill(covariance, covariance + std::size_t{nx} * nx, 0.0);
  const auto at = [&](std::uint32_t r, std::uint32_t c) -> double& { return covariance[std::size_t{r} * nx + c]; };
  for (std::uint32_t i = 0; i < nx; ++i) at(i, i) = (model.quaternion_mask >> i) & 1u ? 0.0 : sd[i] * sd[i] * period_s;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const tiller_joint_t& joint = model.joints[j];
    if (joint.position == TILLER_NO_POSITION) continue;
    const double variance = sd[joint.velocity] * sd[joint.velocity];
    at(joint.position, joint.velocity) += 0.5 * variance * period_s * period_s;
    at(joint.velocity, joint.position) = at(joint.position, joint.velocity);
    at(joint.position, joint.position) += variance * period_s * period_s * period_s / 3.0;
  }
}

}  // namespace tiller
