// Metropolis moves over the window: who moves, where to, and what the data say of it.
//
// While the window begins at a start() the likelihood of a proposal is exact: its filter is rerun from there and
// added to the part before (base). Once transitions have left the window, the filter at its start is a function
// of the parameters fitted to earlier reruns, so the particle's present parameters are rerun beside the proposed
// ones and only the difference of the two is used.

#include <cmath>

#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

namespace {

std::uint32_t round_down(std::uint32_t value, std::uint32_t multiple) { return value / multiple * multiple; }

}  // namespace

void FilterPosterior::move() {
  const auto length = static_cast<std::uint32_t>(window_.end() - window_begin_);
  const bool leaving = length > config_->posterior.window;
  // the fit of what leaves wants the present particles among its lanes, exact or not
  const bool pairs = !window_exact_ || leaving;
  const std::uint32_t moves = count_moves(pairs);
  propose(cloud_, tick_, cursor_, moves, proposals_);
  load_lanes(moves, pairs);
  Rerun job;
  job.lanes = pairs ? 2 * moves : moves;
  job.begin = window_begin_;
  job.end = window_.end();
  job.anew = true;
  job.keep_first = leaving;
  rerun(job);
  accept(moves, pairs);
  if (leaving) {
    summarise(job.lanes);
    window_exact_ = false;
    ++window_begin_;
  }
  cursor_ = (cursor_ + moves) % n_;
  moved_ = moved_ + moves < n_ ? moved_ + moves : n_;
}

/// How many particles move: what the budget of 2 * moves_per_tick * (window + 1) filtered transitions pays for. A
/// short window is cheap, so the cloud is swept fast while it has most to learn; once it has been swept at the full
/// exponent, the configured number suffices. At most half of the cloud: the others say where to move to, and
/// proposals built from particles that stand still leave the target invariant exactly.
std::uint32_t FilterPosterior::count_moves(bool pairs) const {
  const tiller_posterior_config_t& c = config_->posterior;
  const std::uint64_t budget = std::uint64_t{2} * c.moves_per_tick * (c.window + 1);
  const std::uint64_t affordable = budget / (window_.end() - window_begin_) / (pairs ? 2 : 1);
  std::uint32_t moves = affordable < n_ / 2 ? static_cast<std::uint32_t>(affordable) : n_ / 2;
  if (moved_ >= n_ && exponent_ == 1.0 && moves > c.moves_per_tick) moves = c.moves_per_tick;
  return round_down(moves, 8);
}

/// With pairs: the present parameters in lanes 0..moves-1, the proposals behind them; else the proposals alone.
/// The last chunk is filled up with copies of its first lane.
void FilterPosterior::load_lanes(std::uint32_t moves, bool pairs) {
  std::uint32_t lanes = 0;
  for (std::uint32_t m = 0; m < moves && pairs; ++m) set_lane(lanes++, proposals_[m].particle);
  for (std::uint32_t m = 0; m < moves; ++m) set_lane(lanes++, proposals_[m].coordinate);
  while (lanes % kChunk != 0) set_lane(lanes++, proposals_[0].coordinate);
}

void FilterPosterior::set_lane(std::uint32_t lane, const double* coordinate) {
  const Chunk& chunk = chunks_[lane / kChunk];
  const std::uint32_t l = lane % kChunk;
  for (std::uint32_t i = 0; i < np_; ++i) chunk.params[i * kChunk + l] = cloud_.params[i * n_];
  for (std::uint32_t j = 0; j < d_; ++j) {
    chunk.coordinate[j * kChunk + l] = coordinate[j];
    chunk.params[cloud_.inferred[j] * kChunk + l] = from_coordinate(config_->priors[cloud_.inferred[j]], coordinate[j]);
  }
}

void FilterPosterior::set_lane(std::uint32_t lane, std::uint32_t particle) {
  double coordinate[TILLER_MAX_PARAMS];
  for (std::uint32_t j = 0; j < d_; ++j) coordinate[j] = cloud_.coordinate[j * n_ + particle];
  set_lane(lane, coordinate);
}

void FilterPosterior::accept(std::uint32_t moves, bool pairs) {
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) accepted += try_move(proposals_[m], pairs ? moves + m : m, m) ? 1u : 0u;
  acceptance_ += 0.05 * (static_cast<double>(accepted) / moves - acceptance_);
}

/// Metropolis on prior x likelihood^exponent. An accepted particle takes over the filter of its lane.
bool FilterPosterior::try_move(const Proposal& proposal, std::uint32_t lane, std::uint32_t present_lane) {
  const std::uint32_t i = proposal.particle;
  double present[TILLER_MAX_PARAMS];
  for (std::uint32_t j = 0; j < d_; ++j) present[j] = cloud_.coordinate[j * n_ + i];
  const Chunk& to = chunks_[lane / kChunk];
  const Chunk& from = chunks_[present_lane / kChunk];
  const std::uint32_t l = lane % kChunk, k = present_lane % kChunk;

  const double past_squared = past_.squared_error_change(d_, present, proposal.coordinate);
  const double past_log = past_.log_variance_change(d_, present, proposal.coordinate);
  double squared, logs;
  if (window_exact_) {
    squared = carried_.base_squared_error[i] + past_squared + to.squared_error[l];
    logs = carried_.base_log_variance[i] + past_log + to.log_variance[l];
  } else {
    squared = carried_.squared_error[i] + past_squared + (to.squared_error[l] - from.squared_error[k]);
    logs = carried_.log_variance[i] + past_log + (to.log_variance[l] - from.log_variance[k]);
  }
  if (!(squared >= 0.0)) return false;  // NaN too; below zero the past's quadratic has been left behind
  const double updated = log_likelihood(squared, logs);
  const double log_ratio = exponent_ * (updated - carried_.log_likelihood[i]) + proposal.log_prior_change;
  if (!(log_ratio > proposal.log_uniform)) return false;

  for (std::uint32_t j = 0; j < d_; ++j) {
    cloud_.coordinate[j * n_ + i] = proposal.coordinate[j];
    cloud_.params[cloud_.inferred[j] * n_ + i] = to.params[cloud_.inferred[j] * kChunk + l];
  }
  for (std::uint32_t r = 0; r < nx_; ++r) carried_.filter.state[r * n_ + i] = to.filter.state[r * kChunk + l];
  for (std::uint32_t r = 0; r < triangle_; ++r)
    carried_.filter.covariance[r * n_ + i] = to.filter.covariance[r * kChunk + l];
  for (std::uint32_t r = 0; r < ns_; ++r)
    carried_.filter.effect_state[r * n_ + i] = to.filter.effect_state[r * kChunk + l];
  carried_.squared_error[i] = squared;
  carried_.log_variance[i] = logs;
  carried_.base_squared_error[i] += past_squared;
  carried_.base_log_variance[i] += past_log;
  carried_.log_likelihood[i] = updated;
  return true;
}

}  // namespace tiller
