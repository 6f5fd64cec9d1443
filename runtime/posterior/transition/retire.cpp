// A transition leaves the ring: its exact share of each particle's sums, and its polynomials for the summary.

#include <cstring>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

/// The ring is held beyond its window until the cloud has been swept at the full exponent, because a fit over a cloud
/// that is still wide is a poor one; up to its capacity, where the oldest must leave. Afterwards two leave at a tick
/// until the window is reached.
void TransitionCloud::retire() {
  if (d_ == 0 || !config_->posterior.enabled) {
    // nobody moves: nobody asks what a transition says of other parameters
    if (end_ - begin_ > window_) ++begin_;
    return;
  }
  for (int leaving = 0; leaving < 2; ++leaving) {
    const std::uint64_t size = end_ - begin_;
    if (!(size > window_ && (converged() || size == longest_))) return;
    if (leaving == 1 && !converged()) return;
    retire_oldest();
  }
}

void TransitionCloud::retire_oldest() {
  const auto slot = static_cast<std::uint32_t>(begin_ % capacity_);
  ++begin_;
  std::memset(fresh_, 0, sizeof(double) * rows_ * n_);
  sum({{params_, n_}, n_, slot, 1, fresh_, n_});
  transition_table().add_scaled(rows_ * n_, -1.0, fresh_, ring_sums_);

  // a cloud does not move far within a few ticks
  constexpr std::uint64_t kLook = 8;
  if (!summary_.design().laid() || (begin_ % kLook == 0 && !summary_.design().covers(cloud_))) lay_design();
  if (!summarise(slot)) {
    // a point at which the model has no finite step: around the cloud as it is now there may be none
    lay_design();
    if (!summarise(slot)) ++lost_;
  }
}

void TransitionCloud::lay_design() {
  summary_.centre_on(cloud_);
  const PolynomialDesign& design = summary_.design();
  const std::uint32_t points = design.points();
  for (std::uint32_t i = 0; i < np_; ++i)
    for (std::uint32_t k = 0; k < points; ++k) design_params_[i * points + k] = params_[i * n_];
  for (std::uint32_t j = 0; j < cloud_.named; ++j) {
    const std::uint32_t i = cloud_.inferred[j];
    for (std::uint32_t k = 0; k < points; ++k)
      design_params_[i * points + k] =
          static_cast<float>(from_coordinate(config_->priors[i], design.at()[j * points + k]));
  }
}

bool TransitionCloud::summarise(std::uint32_t slot) {
  const std::uint32_t points = summary_.design().points();
  const bool follows = linked(slot);
  float* before = design_residual_ + std::size_t{nx_} * points;
  ResidualJob job;
  job.setup = &setup_;
  job.lanes = points;
  job.count = 1;
  job.steps = steps_ + slot;
  job.params = {design_params_, points};
  job.residual = design_residual_;
  table_->residual(*config_->model, job);
  work_ += points;
  if (follows) {
    job.steps = steps_ + slot_before(slot);
    job.residual = before;
    table_->residual(*config_->model, job);
    work_ += points;
  }
  return summary_.add(design_residual_, before, counted(slot));
}

}  // namespace tiller
