// When and in which units the discrepancy's regressors 1, v, tanh(v / v0) of each joint come into force.

#include <cmath>
#include <cstring>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

namespace {

/// Transitions after which the velocities' scale is taken, once and for all: sums over different regressors would not
/// add up.
constexpr std::uint32_t kScaleTicks = 16;
/// Width of the step from one sign of Coulomb friction to the other, in root mean squares of the velocity.
constexpr double kStepWidth = 0.2;

}  // namespace

void TransitionCloud::set_basis(std::uint32_t slot) {
  for (std::uint32_t j = 0; j < evidence_.joints(); ++j) {
    float* b = basis_ + slot * columns_ + j * kDiscrepancyBasis;
    const double v = velocity_scale_[j] * steps_[slot].state[evidence_.velocity(j)];
    b[0] = velocity_scale_[j] > 0.0 ? 1.0f : 0.0f;
    b[1] = static_cast<float>(v);
    b[2] = static_cast<float>(std::tanh(v / kStepWidth));
  }
}

/// Takes the scales from what the ring holds and gives the newest transitions there, the latest of all included, their
/// regressors and every particle its projections. Waits while a joint stands still. Cost: kScaleTicks steps of the model
/// per particle, once; the moves of that tick get as much less.
void TransitionCloud::begin_discrepancy() {
  const std::uint64_t size = end_ - begin_;
  if (discrepancy_begun_ || evidence_.joints() == 0 || size < kScaleTicks) return;
  double scale[TILLER_MAX_JOINTS];
  for (std::uint32_t j = 0; j < evidence_.joints(); ++j) {
    double square = 0.0;
    for (std::uint64_t k = end_ - kScaleTicks; k < end_; ++k) {
      const double v = steps_[k % capacity_].state[evidence_.velocity(j)];
      square += v * v / kScaleTicks;
    }
    if (!(square > 0.0)) return;
    scale[j] = 1.0 / std::sqrt(square);
  }
  std::memcpy(velocity_scale_, scale, sizeof velocity_scale_);
  discrepancy_begun_ = true;

  std::memset(fresh_, 0, sizeof(double) * rows_ * n_);
  for (std::uint64_t k = end_ - kScaleTicks; k < end_; ++k) {
    const auto slot = static_cast<std::uint32_t>(k % capacity_);
    set_basis(slot);
    evidence_.add_basis(weight_ + slot * nx_, basis_ + slot * columns_);
    sum({{params_, n_}, n_, slot, 1, fresh_, n_});
  }
  const std::size_t first = std::size_t{nx_} * n_;
  const std::uint32_t count = (rows_ - nx_) * n_;
  transition_table().add_scaled(count, 1.0, fresh_ + first, total_ + first);
  transition_table().add_scaled(count, 1.0, fresh_ + first, ring_sums_ + first);
  evidence_.prepare();
}

}  // namespace tiller
