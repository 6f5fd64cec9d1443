// Metropolis moves over the window: who moves, where to, and what the data say of it.
//
// While the window begins at a start() the likelihood of a proposal is exact: its filter is rerun from there and
// added to the part before (base). Once transitions have left the window, the filter at its start is a function
// of the parameters fitted to what left, so the particle's present parameters are rerun beside the proposed
// ones and only the difference of the two is used.

#include <cmath>
#include <cstring>

#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

namespace {

std::uint32_t round_down(std::uint32_t value, std::uint32_t multiple) { return value / multiple * multiple; }
std::uint32_t round_up(std::uint32_t value, std::uint32_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace

void FilterPosterior::move() {
  const bool pairs = !window_exact_;
  const std::uint32_t moves = count_moves(pairs);
  if (moves == 0) return;
  const Guides guides = {&shape_, carried_.log_likelihood, exponent_, disturbances_.swings() ? &swing_ : nullptr};
  propose(cloud_, tick_, cursor_, moves, proposals_, guided() ? &guides : nullptr);
  load_lanes(moves, pairs);
  rerun(pairs ? 2 * moves : moves);
  sum_past(moves);
  sum_proposals(moves, pairs);
  accept(moves, pairs);
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

/// The proposals in lanes 0..moves-1, with pairs the present parameters behind them. The last chunk is filled up with
/// copies of the first lane.
void FilterPosterior::load_lanes(std::uint32_t moves, bool pairs) {
  std::uint32_t lane = 0;
  const auto place = [&](const double* coordinate) {
    place_lane(chunks_[lane / kChunk], lane % kChunk, coordinate);
    ++lane;
  };
  for (std::uint32_t m = 0; m < moves; ++m) place(proposals_[m].coordinate);
  for (std::uint32_t m = 0; m < moves && pairs; ++m) {
    double present[kMaxCoordinates];
    for (std::uint32_t j = 0; j < d_; ++j) present[j] = cloud_.coordinate[j * n_ + proposals_[m].particle];
    place(present);
  }
  while (lane % kChunk != 0) place(proposals_[0].coordinate);
}

void FilterPosterior::place_lane(const Chunk& chunk, std::uint32_t l, const double* coordinate) const {
  for (std::uint32_t i = 0; i < np_; ++i) chunk.params[i * kChunk + l] = cloud_.params[i * n_];
  for (std::uint32_t j = 0; j < d_; ++j) chunk.coordinate[j * kChunk + l] = coordinate[j];
  for (std::uint32_t j = 0; j < cloud_.named; ++j) {
    const std::uint32_t i = cloud_.inferred[j];
    chunk.params[i * kChunk + l] = from_coordinate(config_->priors[i], coordinate[j]);
  }
  read_own(coordinate, 1, chunk.process_scale + l, lacks_ > 0 ? chunk.law + l : nullptr, kChunk);
}

/// The summary's log density of each proposal less that of the present parameters.
void FilterPosterior::sum_past(std::uint32_t moves) {
  const std::uint32_t lanes = round_up(moves, kChunk);
  std::memset(proposed_sums_, 0, sizeof(double) * rows_ * move_lanes_);
  const auto add = [&](double factor, const auto& coordinate) {
    for (std::uint32_t m = 0; m < lanes; ++m)
      for (std::uint32_t j = 0; j < d_; ++j)
        move_coordinate_[j * move_lanes_ + m] = coordinate(proposals_[m < moves ? m : 0], j);
    summary_.add_sums(lanes, move_coordinate_, move_lanes_, factor, proposed_sums_, move_lanes_);
  };
  add(1.0, [](const Proposal& p, std::uint32_t j) { return p.coordinate[j]; });
  add(-1.0, [this](const Proposal& p, std::uint32_t j) { return cloud_.coordinate[j * n_ + p.particle]; });
}

/// A proposal's sums over all data.
void FilterPosterior::sum_proposals(std::uint32_t moves, bool pairs) {
  for (std::uint32_t r = 0; r < rows_; ++r)
    for (std::uint32_t m = 0; m < moves; ++m) {
      const std::uint32_t i = proposals_[m].particle, present = moves + m;
      const double over_window = chunks_[m / kChunk].sums[r * kChunk + m % kChunk];
      const double before =
          pairs ? carried_.sums[r * n_ + i] - chunks_[present / kChunk].sums[r * kChunk + present % kChunk]
                : carried_.base[r * n_ + i];
      proposed_sums_[r * move_lanes_ + m] += before + over_window;
    }
}

/// Metropolis on prior x likelihood^exponent.
void FilterPosterior::accept(std::uint32_t moves, bool pairs) {
  double* updated = scratch_row(0);
  evidence_.log_likelihood(moves, proposed_sums_, move_lanes_, updated);
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) {
    const Proposal& p = proposals_[m];
    const double change = exponent_ * (updated[m] - carried_.log_likelihood[p.particle]) + p.log_correction;
    if (!(change > p.log_uniform)) continue;  // NaN too
    ++accepted;
    carried_.log_likelihood[p.particle] = updated[m];
    if (!pairs)
      for (std::uint32_t r = 0; r < rows_; ++r)
        carried_.base[r * n_ + p.particle] =
            proposed_sums_[r * move_lanes_ + m] - chunks_[m / kChunk].sums[r * kChunk + m % kChunk];
    take_over(p, m, m);
  }
  acceptance_ += 0.05 * (static_cast<double>(accepted) / moves - acceptance_);
}

/// An accepted particle takes over the filter of its lane.
void FilterPosterior::take_over(const Proposal& proposal, std::uint32_t lane, std::uint32_t move) {
  const std::uint32_t i = proposal.particle, l = lane % kChunk;
  const Chunk& from = chunks_[lane / kChunk];
  cloud_.set_coordinate(i, proposal.coordinate);
  carried_.process_scale[i] = from.process_scale[l];
  for (std::uint32_t r = 0; r < disturbances_.law_rows(); ++r) carried_.law[r * n_ + i] = from.law[r * kChunk + l];
  for (std::uint32_t r = 0; r < nf_; ++r) carried_.filter.state[r * n_ + i] = from.filter.state[r * kChunk + l];
  for (std::uint32_t r = 0; r < triangle_; ++r)
    carried_.filter.covariance[r * n_ + i] = from.filter.covariance[r * kChunk + l];
  for (std::uint32_t r = 0; r < ns_; ++r)
    carried_.filter.effect_state[r * n_ + i] = from.filter.effect_state[r * kChunk + l];
  for (std::uint32_t r = 0; r < rows_; ++r) carried_.sums[r * n_ + i] = proposed_sums_[r * move_lanes_ + move];
}

}  // namespace tiller
