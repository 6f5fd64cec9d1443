// Metropolis moves: a proposal's residuals are taken over the ring, the summary answers for what came before.

#include <cmath>
#include <cstring>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

/// Sweeps while the work lasts: a short ring is cheap, so early on a tick may sweep the whole cloud and raise the
/// exponent more than once. Once the cloud has been swept at the full exponent, moves_per_tick is enough.
void TransitionCloud::move() {
  const std::uint32_t per_tick = config_->posterior.moves_per_tick;
  std::uint64_t left = std::uint64_t{per_tick} * (window_ + kProposalWork);
  const std::uint64_t cost = (end_ - begin_) + kProposalWork;
  std::uint32_t done = 0;
  for (;;) {
    std::uint64_t moves = left / cost;
    if (moves > n_ / 2) moves = n_ / 2;
    if (converged()) {
      if (done >= per_tick) return;
      if (moves > per_tick - done) moves = per_tick - done;
    }
    moves = moves / 8 * 8;
    if (moves == 0) return;
    done += move_batch(static_cast<std::uint32_t>(moves));
    left -= moves * cost;
    if (exponent_ < 1.0 && moved_ >= n_) raise();
  }
}

std::uint32_t TransitionCloud::move_batch(std::uint32_t moves) {
  propose(cloud_, ++batch_, cursor_, moves, proposals_);
  const std::uint32_t lanes = (moves + 15) / 16 * 16;
  for (std::uint32_t i = 0; i < np_; ++i)
    for (std::uint32_t m = 0; m < lanes; ++m) proposed_params_[i * lanes_ + m] = params_[i * n_];
  for (std::uint32_t j = 0; j < d_; ++j) {
    const std::uint32_t i = cloud_.inferred[j];
    float* row = proposed_params_ + i * lanes_;
    for (std::uint32_t m = 0; m < moves; ++m)
      row[m] = static_cast<float>(from_coordinate(config_->priors[i], proposals_[m].coordinate[j]));
    for (std::uint32_t m = moves; m < lanes; ++m) row[m] = row[0];
  }
  for (std::uint32_t r = 0; r < rows_; ++r) std::memset(proposed_ring_ + r * lanes_, 0, sizeof(double) * lanes);
  sum_ring({proposed_params_, lanes_}, lanes, proposed_ring_, lanes_);
  judge(moves);
  cursor_ = (cursor_ + moves) % n_;
  moved_ = moved_ + moves < n_ ? moved_ + moves : n_;
  return moves;
}

/// Metropolis on prior x likelihood^exponent.
void TransitionCloud::judge(std::uint32_t moves) {
  const std::uint32_t lanes = (moves + 15) / 16 * 16;
  for (std::uint32_t m = 0; m < lanes; ++m) {
    const Proposal& p = proposals_[m < moves ? m : 0];
    for (std::uint32_t r = 0; r < rows_; ++r) {
      const std::size_t at = std::size_t{r} * n_ + p.particle;
      proposed_total_[r * lanes_ + m] = total_[at] - ring_sums_[at] + proposed_ring_[r * lanes_ + m];
    }
    for (std::uint32_t j = 0; j < d_; ++j) {
      proposed_coordinate_[j * lanes_ + m] = p.coordinate[j];
      present_coordinate_[j * lanes_ + m] = cloud_.coordinate[j * n_ + p.particle];
    }
  }
  summary_.add_sums(lanes, proposed_coordinate_, 1.0, proposed_total_, lanes_);
  summary_.add_sums(lanes, present_coordinate_, -1.0, proposed_total_, lanes_);
  evidence_.log_likelihood(lanes, proposed_total_, lanes_, proposed_likelihood_);
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) {
    const Proposal& p = proposals_[m];
    const double change = proposed_likelihood_[m] - log_likelihood_[p.particle];
    if (!(exponent_ * change + p.log_prior_change > p.log_uniform)) continue;  // NaN is refused
    ++accepted;
    cloud_.set_coordinate(p.particle, p.coordinate);
    for (std::uint32_t i = 0; i < np_; ++i) params_[i * n_ + p.particle] = proposed_params_[i * lanes_ + m];
    for (std::uint32_t r = 0; r < rows_; ++r) {
      total_[r * n_ + p.particle] = proposed_total_[r * lanes_ + m];
      ring_sums_[r * n_ + p.particle] = proposed_ring_[r * lanes_ + m];
    }
    log_likelihood_[p.particle] = proposed_likelihood_[m];
  }
  acceptance_ += 0.05 * (static_cast<double>(accepted) / moves - acceptance_);
}

}  // namespace tiller
