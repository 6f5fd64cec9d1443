// Metropolis moves: a proposal's residuals are taken over the ring, the summary answers for what came before.

#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "posterior/proposals.hpp"
#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

namespace {

/// Random numbers of the steps that lead out of a degenerate cloud, apart from the scouts' of the same stream.
constexpr std::uint64_t kWidening = std::uint64_t{1} << 60;

/// Share of the moves that are drawn independently from the cloud's own Student-t.
constexpr double kIndependent = 0.5;

}  // namespace

/// Sweeps while the work lasts: a short ring is cheap, so early on a tick may sweep the whole cloud and raise the
/// exponent more than once. Once the cloud has been swept at the full exponent, moves_per_tick is enough.
void TransitionCloud::move() {
  const std::uint32_t per_tick = config_->posterior.moves_per_tick;
  const std::uint64_t budget = std::uint64_t{per_tick} * (window_ + kProposalWork);
  // less what was spent beyond the one transition of an ordinary tick
  const std::uint64_t spent = work_ - std::uint64_t{n_} * steps_of_one_;
  std::uint64_t left = budget > spent ? budget - spent : 0;
  const std::uint64_t cost = (end_ - begin_) + (steps_of_one_ - 1) + kProposalWork;
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
  const std::uint32_t lanes = (moves + 15) / 16 * 16;
  propose(moves);
  for (std::uint32_t i = 0; i < np_; ++i)
    for (std::uint32_t m = 0; m < lanes; ++m) proposed_params_[i * lanes_ + m] = params_[i * n_];
  for (std::uint32_t j = 0; j < d_; ++j) {
    const std::uint32_t i = cloud_.inferred[j];
    const double* coordinate = proposed_coordinate_ + j * lanes_;
    for (std::uint32_t m = 0; m < lanes; ++m)
      proposed_params_[i * lanes_ + m] = static_cast<float>(from_coordinate(config_->priors[i], coordinate[m]));
  }
  for (std::uint32_t r = 0; r < rows_; ++r) std::memset(proposed_ring_ + r * lanes_, 0, sizeof(double) * lanes);
  sum_ring({proposed_params_, lanes_}, lanes, proposed_ring_, lanes_);
  accept_reject(moves);
  cursor_ = (cursor_ + moves) % n_;
  moved_ = moved_ + moves < n_ ? moved_ + moves : n_;
  return moves;
}

void TransitionCloud::propose(std::uint32_t moves) {
  double low[kMaxCoordinates], high[kMaxCoordinates];
  for (std::uint32_t j = 0; j < d_; ++j) {
    low[j] = cloud_.prior.low(j);
    high[j] = cloud_.prior.high(j);
  }
  ProposalJob job;
  job.d = d_;
  job.n = n_;
  job.cursor = cursor_;
  job.moves = moves;
  std::uint32_t keys[kProposalWords + 1][2];
  ++batch_;
  for (std::uint32_t row = 0; row < kProposalWords; row += 2) {
    const Philox::Words words = Philox::draw(config_->seed, batch_ * 64 + row, std::uint64_t{kRngMove} << 32);
    std::memcpy(keys[row], words.w, sizeof words.w);
  }
  job.keys = keys;
  job.independent = kIndependent;
  job.coordinate = cloud_.coordinate;
  job.weight = cloud_.weight;
  job.low = low;
  job.high = high;
  job.present = present_coordinate_;
  job.proposed = proposed_coordinate_;
  job.log_change = proposed_change_;
  job.log_uniform = proposed_uniform_;
  job.stride = lanes_;
  bool whole = true;
  job.whole = &whole;
  transition_table().propose(job);
  if (!whole) inflate(moves);
  const double scouts = config_->posterior.prior_proposal_fraction;
  if (flat_prior_ && !(scouts > 0.0)) return;
  for (std::uint32_t m = 0; m < moves; ++m) {
    double present[kMaxCoordinates], proposed[kMaxCoordinates];
    for (std::uint32_t j = 0; j < d_; ++j) {
      present[j] = present_coordinate_[j * lanes_ + m];
      proposed[j] = proposed_coordinate_[j * lanes_ + m];
    }
    Rng rng(config_->seed, kRngScout, batch_ * 4096 + m);
    if (scouts > 0.0 && rng.uniform() < scouts) {
      // an independent draw from the prior, whose density cancels out of the ratio
      cloud_.prior.draw_one(rng, proposed);
      for (std::uint32_t j = 0; j < d_; ++j) proposed_coordinate_[j * lanes_ + m] = proposed[j];
      proposed_change_[m] = 0.0;
    } else if (!flat_prior_) {
      proposed_change_[m] += cloud_.prior.log_density(proposed) - cloud_.prior.log_density(present);
    }
  }
}

/// Every other proposal is a step of one coordinate.
void TransitionCloud::inflate(std::uint32_t moves) {
  for (std::uint32_t m = 1; m < moves; m += 2) {
    Rng rng(config_->seed, kRngScout, kWidening + batch_ * 4096 + m);
    const auto [moving, length] = draw_coordinate_step(cloud_.prior, rng);
    for (std::uint32_t j = 0; j < d_; ++j) {
      const double present = present_coordinate_[j * lanes_ + m];
      proposed_coordinate_[j * lanes_ + m] = j == moving ? present + length : present;
    }
    const double to = proposed_coordinate_[moving * lanes_ + m];
    const bool inside = to >= cloud_.prior.low(moving) && to <= cloud_.prior.high(moving);
    if (!inside) proposed_coordinate_[moving * lanes_ + m] = present_coordinate_[moving * lanes_ + m];
    proposed_change_[m] = inside ? 0.0 : -INFINITY;
  }
}

/// Metropolis on prior x likelihood^exponent.
void TransitionCloud::accept_reject(std::uint32_t moves) {
  const std::uint32_t lanes = (moves + 15) / 16 * 16, wrap = n_ - cursor_;
  for (std::uint32_t r = 0; r < rows_; ++r) {
    const double *total = total_ + r * n_ + cursor_, *ring = ring_sums_ + r * n_ + cursor_;
    const double* proposed = proposed_ring_ + r * lanes_;
    double* to = proposed_total_ + r * lanes_;
    const std::uint32_t head = moves < wrap ? moves : wrap;
    for (std::uint32_t m = 0; m < head; ++m) to[m] = total[m] - ring[m] + proposed[m];
    for (std::uint32_t m = head; m < moves; ++m) to[m] = *(total + m - n_) - *(ring + m - n_) + proposed[m];
    for (std::uint32_t m = moves; m < lanes; ++m) to[m] = 0.0;
  }
  summary_.add_sums(lanes, proposed_coordinate_, 1.0, proposed_total_, lanes_);
  summary_.add_sums(lanes, present_coordinate_, -1.0, proposed_total_, lanes_);
  evidence_.log_likelihood(lanes, proposed_total_, lanes_, proposed_likelihood_);
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) {
    const std::uint32_t i = m < wrap ? cursor_ + m : m - wrap;
    const double change = proposed_likelihood_[m] - log_likelihood_[i];
    if (!(exponent_ * change + proposed_change_[m] > proposed_uniform_[m])) continue;  // NaN is refused
    ++accepted;
    for (std::uint32_t j = 0; j < d_; ++j) {
      const std::uint32_t row = cloud_.inferred[j];
      const double to = proposed_coordinate_[j * lanes_ + m];
      cloud_.coordinate[j * n_ + i] = to;
      cloud_.params[row * n_ + i] = from_coordinate(config_->priors[row], to);
      params_[row * n_ + i] = proposed_params_[row * lanes_ + m];
    }
    for (std::uint32_t r = 0; r < rows_; ++r) {
      total_[r * n_ + i] = proposed_total_[r * lanes_ + m];
      ring_sums_[r * n_ + i] = proposed_ring_[r * lanes_ + m];
    }
    log_likelihood_[i] = proposed_likelihood_[m];
  }
  acceptance_ += 0.05 * (static_cast<double>(accepted) / moves - acceptance_);
}

}  // namespace tiller
