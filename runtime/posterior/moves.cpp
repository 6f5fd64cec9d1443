// Metropolis moves over the window: who moves, where to, and what the data say of it.
//
// While the window begins at a start() the likelihood of a proposal is exact: its filter is rerun from there and
// added to the part before (base). Once transitions have left the window, the filter at its start is a function
// of the parameters fitted to earlier reruns, so the particle's present parameters are rerun beside the proposed
// ones and only the difference of the two is used.

#include <cmath>

#include "core/rng.hpp"
#include "posterior/posterior.hpp"
#include "posterior/prior.hpp"

namespace tiller {

namespace {

/// Best step of a random walk on a d-dimensional normal, in deviations (Roberts, Gelman and Gilks 1997); a
/// difference of two particles has twice the variance (ter Braak 2006).
constexpr double kOptimalStep = 2.38;
/// Share of differential evolution among the proposals; the rest is a random walk with the cloud's covariance.
constexpr double kEvolution = 0.7;
/// Share of those that take a whole difference, to cross between separate modes.
constexpr double kWholeDifference = 0.1;
/// Random walk added to a difference, so that particles that are copies of one another part.
constexpr double kJitter = 0.05;

std::uint32_t round_down(std::uint32_t value, std::uint32_t multiple) { return value / multiple * multiple; }

}  // namespace

void Posterior::move() {
  const auto length = static_cast<std::uint32_t>(window_.end() - window_begin_);
  const bool leaving = length > config_->posterior.window;
  // the fit of what leaves wants the present particles among its lanes, exact or not
  const bool pairs = !window_exact_ || leaving;
  const std::uint32_t moves = count_moves(pairs);
  propose(moves);
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
std::uint32_t Posterior::count_moves(bool pairs) const {
  const tiller_posterior_config_t& c = config_->posterior;
  const std::uint64_t budget = std::uint64_t{2} * c.moves_per_tick * (c.window + 1);
  const std::uint64_t affordable = budget / (window_.end() - window_begin_) / (pairs ? 2 : 1);
  std::uint32_t moves = affordable < n_ / 2 ? static_cast<std::uint32_t>(affordable) : n_ / 2;
  if (moved_ >= n_ && exponent_ == 1.0 && moves > c.moves_per_tick) moves = c.moves_per_tick;
  return round_down(moves, 8);
}

/// Lower Cholesky factor (d x d, stride TILLER_MAX_PARAMS) of the covariance of the particles that stand still.
void Posterior::spread(std::uint32_t first_still, std::uint32_t still, double* factor) const {
  double mean[TILLER_MAX_PARAMS] = {}, sum = 0.0;
  for (std::uint32_t k = 0; k < still; ++k) {
    const std::uint32_t i = (first_still + k) % n_;
    sum += cloud_.weight[i];
    for (std::uint32_t j = 0; j < d_; ++j) mean[j] += cloud_.weight[i] * cloud_.coordinate[j * n_ + i];
  }
  for (std::uint32_t j = 0; j < d_; ++j) mean[j] /= sum;
  double square[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS] = {};
  for (std::uint32_t k = 0; k < still; ++k) {
    const std::uint32_t i = (first_still + k) % n_;
    double off[TILLER_MAX_PARAMS];
    for (std::uint32_t j = 0; j < d_; ++j) off[j] = cloud_.coordinate[j * n_ + i] - mean[j];
    for (std::uint32_t r = 0; r < d_; ++r)
      for (std::uint32_t c = 0; c <= r; ++c)
        square[r * TILLER_MAX_PARAMS + c] += cloud_.weight[i] / sum * off[r] * off[c];
  }
  for (std::uint32_t r = 0; r < d_; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = square[r * TILLER_MAX_PARAMS + c];
      for (std::uint32_t k = 0; k < c; ++k)
        rest -= factor[r * TILLER_MAX_PARAMS + k] * factor[c * TILLER_MAX_PARAMS + k];
      // coordinates that are functions of one another leave nothing: the walk then stays on their line
      const double pivot = factor[c * TILLER_MAX_PARAMS + c];
      factor[r * TILLER_MAX_PARAMS + c] = r == c ? std::sqrt(std::fmax(rest, 0.0)) : pivot > 0.0 ? rest / pivot : 0.0;
    }
  }
}

void Posterior::propose(std::uint32_t moves) {
  const std::uint32_t first_still = (cursor_ + moves) % n_, still = n_ - moves;
  double factor[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS] = {};
  spread(first_still, still, factor);
  const double best = kOptimalStep / std::sqrt(static_cast<double>(d_));

  for (std::uint32_t m = 0; m < moves; ++m) {
    Proposal& p = proposals_[m];
    p.particle = (cursor_ + m) % n_;
    Rng rng(config_->seed, kRngMove, tick_ * 4096 + p.particle);
    double walk[TILLER_MAX_PARAMS], difference = 0.0, noise = kJitter;
    const std::uint32_t a = (first_still + rng.below(still)) % n_, b = (first_still + rng.below(still)) % n_;
    if (rng.uniform() < kEvolution)
      difference = rng.uniform() < kWholeDifference ? 1.0 : best * 0.70710678 * (0.3 + 0.7 * rng.uniform());
    else
      noise = best * std::exp(-2.3 * rng.uniform());  // a decade of step lengths: far and near both occur
    for (std::uint32_t j = 0; j < d_; ++j) walk[j] = noise * rng.normal();

    p.log_prior_change = 0.0;
    for (std::uint32_t j = 0; j < d_; ++j) {
      const double* row = cloud_.coordinate + j * n_;
      const tiller_prior_t& prior = config_->priors[inferred_[j]];
      double to = row[p.particle] + difference * (row[a] - row[b]);
      for (std::uint32_t k = 0; k <= j; ++k) to += factor[j * TILLER_MAX_PARAMS + k] * walk[k];
      // reflection keeps the proposal symmetric and does not waste it at a bound
      if (to < coordinate_low(prior)) to = 2.0 * coordinate_low(prior) - to;
      if (to > coordinate_high(prior)) to = 2.0 * coordinate_high(prior) - to;
      p.log_prior_change += log_prior(prior, to) - log_prior(prior, row[p.particle]);
      p.coordinate[j] = to;
    }
    // refused by the prior: its lane still runs, where the particle is
    if (!std::isfinite(p.log_prior_change)) {
      p.log_prior_change = -INFINITY;
      for (std::uint32_t j = 0; j < d_; ++j) p.coordinate[j] = cloud_.coordinate[j * n_ + p.particle];
    }
    p.log_uniform = std::log(rng.uniform());
  }
}

/// With pairs: the present parameters in lanes 0..moves-1, the proposals behind them; else the proposals alone.
/// The last chunk is filled up with copies of its first lane.
void Posterior::load_lanes(std::uint32_t moves, bool pairs) {
  std::uint32_t lanes = 0;
  for (std::uint32_t m = 0; m < moves && pairs; ++m) set_lane(lanes++, proposals_[m].particle);
  for (std::uint32_t m = 0; m < moves; ++m) set_lane(lanes++, proposals_[m].coordinate);
  while (lanes % kChunk != 0) set_lane(lanes++, proposals_[0].coordinate);
}

void Posterior::set_lane(std::uint32_t lane, const double* coordinate) {
  const Chunk& chunk = chunks_[lane / kChunk];
  const std::uint32_t l = lane % kChunk;
  for (std::uint32_t i = 0; i < np_; ++i) chunk.params[i * kChunk + l] = cloud_.params[i * n_];
  for (std::uint32_t j = 0; j < d_; ++j) {
    chunk.coordinate[j * kChunk + l] = coordinate[j];
    chunk.params[inferred_[j] * kChunk + l] = from_coordinate(config_->priors[inferred_[j]], coordinate[j]);
  }
}

void Posterior::set_lane(std::uint32_t lane, std::uint32_t particle) {
  double coordinate[TILLER_MAX_PARAMS];
  for (std::uint32_t j = 0; j < d_; ++j) coordinate[j] = cloud_.coordinate[j * n_ + particle];
  set_lane(lane, coordinate);
}

void Posterior::accept(std::uint32_t moves, bool pairs) {
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) accepted += try_move(proposals_[m], pairs ? moves + m : m, m) ? 1u : 0u;
  acceptance_ += 0.05 * (static_cast<double>(accepted) / moves - acceptance_);
}

/// Metropolis on prior x likelihood^exponent. An accepted particle takes over the filter of its lane.
bool Posterior::try_move(const Proposal& proposal, std::uint32_t lane, std::uint32_t present_lane) {
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
    squared = cloud_.base_squared_error[i] + past_squared + to.squared_error[l];
    logs = cloud_.base_log_variance[i] + past_log + to.log_variance[l];
  } else {
    squared = cloud_.squared_error[i] + past_squared + (to.squared_error[l] - from.squared_error[k]);
    logs = cloud_.log_variance[i] + past_log + (to.log_variance[l] - from.log_variance[k]);
  }
  if (!(squared >= 0.0)) return false;  // NaN too; below zero the past's quadratic has been left behind
  const double updated = log_likelihood(squared, logs);
  const double log_ratio = exponent_ * (updated - cloud_.log_likelihood[i]) + proposal.log_prior_change;
  if (!(log_ratio > proposal.log_uniform)) return false;

  for (std::uint32_t j = 0; j < d_; ++j) {
    cloud_.coordinate[j * n_ + i] = proposal.coordinate[j];
    cloud_.params[inferred_[j] * n_ + i] = to.params[inferred_[j] * kChunk + l];
  }
  for (std::uint32_t r = 0; r < nx_; ++r) cloud_.filter.state[r * n_ + i] = to.filter.state[r * kChunk + l];
  for (std::uint32_t r = 0; r < triangle_; ++r)
    cloud_.filter.covariance[r * n_ + i] = to.filter.covariance[r * kChunk + l];
  for (std::uint32_t r = 0; r < ns_; ++r)
    cloud_.filter.effect_state[r * n_ + i] = to.filter.effect_state[r * kChunk + l];
  cloud_.squared_error[i] = squared;
  cloud_.log_variance[i] = logs;
  cloud_.base_squared_error[i] += past_squared;
  cloud_.base_log_variance[i] += past_log;
  cloud_.log_likelihood[i] = updated;
  return true;
}

}  // namespace tiller
