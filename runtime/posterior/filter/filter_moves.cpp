#include "posterior/filter/filter_moves.hpp"

#include <algorithm>
#include <cmath>

#include "core/bits.hpp"
#include "posterior/tasks.hpp"

namespace tiller {

FilterMoves FilterMoves::lay_out(Arena& arena, const Cloud& cloud, const DisturbanceStates& disturbances) {
  FilterMoves m;
  m.lanes_ = round_up(cloud.n / 2, kLanes);
  m.proposals_ = arena.take<Proposal>(cloud.n / 2);
  auto* const proposed = arena.take<double>(std::size_t{cloud.d} * (cloud.n / 2));
  for (std::uint32_t i = 0; m.proposals_ && proposed && i < cloud.n / 2; ++i)
    m.proposals_[i].coordinate = proposed + std::size_t{i} * cloud.d;
  m.sums_ = arena.take<double>(std::size_t{kRows} * m.lanes_);
  m.coordinate_ = arena.take<double>(std::size_t{cloud.d} * m.lanes_);
  if (guided(cloud)) m.shape_ = LikelihoodShape::lay_out(arena, cloud.d);
  if (disturbances.swings()) m.swing_ = SwingLaw::lay_out(arena, disturbances.joints());
  return m;
}

void FilterMoves::reset(const Cloud& cloud, const DisturbanceStates& disturbances) {
  shape_.clear();
  if (guided(cloud) && disturbances.swings())
    swing_.begin(cloud.prior, cloud.d - disturbances.drifts() - 2, disturbances.sizes(), cloud.config->period_s);
}

void FilterMoves::note_swing(const FilterParticles& particles) {
  const DisturbanceStates& disturbances = *particles.disturbances;
  if (!guided(particles.cloud) || !disturbances.swings()) return;
  const std::uint32_t nx = particles.nf - disturbances.states();
  double force[TILLER_MAX_JOINTS] = {};
  for (std::uint32_t j = 0; j < disturbances.joints(); ++j) {
    const double mean = particles.mean(particles.state(nx + disturbances.force_state(j)));
    const double size = disturbances.size_of(j);
    force[j] = size > 0.0 ? mean / size : 0.0;
  }
  swing_.observe(force);
}

void FilterMoves::move(const Job& job, FilterParticles& particles, Tempering& tempering) {
  const Cloud& cloud = particles.cloud;
  const bool pairs = !job.window.exact();
  const std::uint32_t moves = count_moves(job.window, cloud, tempering);
  if (moves == 0) return;
  const Guides guides = {&shape_, particles.log_likelihood, tempering.exponent(),
                         particles.disturbances->swings() ? &swing_ : nullptr};
  const Proposer proposer(cloud, job.tick, tempering.cursor(), moves, guided(cloud) ? &guides : nullptr);
  const std::uint32_t lanes = pairs ? 2 * moves : moves;
  for_each_chunk(job.hooks, (lanes + kLanes - 1) / kLanes, true, [&](std::uint32_t c) {
    const FilterChunk& chunk = job.tools.chunks[c];
    load_lanes(proposer, particles, moves, lanes, c * kLanes, chunk);
    rerun(job, chunk);
    if (c * kLanes < moves) sum_past(job.past.summary(), proposer, cloud.d, moves, c * kLanes);
  });
  sum_proposals(job.tools.chunks, particles, moves, pairs);
  tempering.note_moves(cloud, moves, accept(job, particles, moves, tempering.exponent()));
}

/// How many particles move: what the budget of 2 * moves_per_tick * (window + 1) filtered transitions pays for. A
/// short window is cheap, so the cloud is swept fast while it has most to learn; once it has been swept at the full
/// exponent, the configured number suffices. At most half of the cloud: the others say where to move to, and
/// proposals built from particles that stand still leave the target invariant exactly.
std::uint32_t FilterMoves::count_moves(const FilterWindow& window, const Cloud& cloud, const Tempering& tempering) {
  const tiller_posterior_config_t& c = cloud.config->posterior;
  const std::uint64_t budget = std::uint64_t{2} * c.moves_per_tick * (c.window + 1);
  const std::uint64_t affordable = budget / window.size() / (window.exact() ? 1 : 2);
  std::uint32_t moves = affordable < cloud.n / 2 ? static_cast<std::uint32_t>(affordable) : cloud.n / 2;
  if (tempering.settled(cloud) && moves > c.moves_per_tick) moves = c.moves_per_tick;
  return moves / 8 * 8;
}

/// Of the proposals in lanes 0..moves-1, and behind them with pairs the present parameters, a chunk's from `first` on.
/// The last chunk is filled up with some parameters.
void FilterMoves::load_lanes(const Proposer& proposer, const FilterParticles& particles, std::uint32_t moves,
                             std::uint32_t lanes, std::uint32_t first, const FilterChunk& chunk) const {
  double present[kMaxCoordinates];
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    const std::uint32_t lane = first + l;
    if (lane < moves) {
      proposer.draw(lane, proposals_[lane]);
      particles.place(chunk, l, proposals_[lane].coordinate);
    } else {
      proposer.read_present(lane < lanes ? lane - moves : 0, present);
      particles.place(chunk, l, present);
    }
  }
}

/// The chunk's lanes over the whole window: their filters and their sums over it.
void FilterMoves::rerun(const Job& job, const FilterChunk& chunk) {
  const LaneFilter& filter = job.tools.filter;
  chunk.clear_sums();
  if (job.window.exact())
    job.tools.start.begin_filters(filter, chunk, chunk.filter, {chunk.params, kLanes}, {chunk.law, kLanes});
  else
    job.past.begin_filters(filter, chunk);
  for (std::uint64_t k = job.window.begin(); k < job.window.end(); ++k)
    filter.step_own(chunk, job.window.at(k), chunk.filter);
}

/// The summary's log density of the proposals of a chunk less that of the present parameters.
void FilterMoves::sum_past(const FilterSummary& summary, const Proposer& proposer, std::uint32_t d, std::uint32_t moves,
                           std::uint32_t first) const {
  double* const sums = sums_ + first;
  double* const coordinate = coordinate_ + first;
  for (std::uint32_t r = 0; r < kRows; ++r) std::fill_n(sums + std::size_t{r} * lanes_, kLanes, 0.0);
  const auto add = [&](double factor, const auto& read) {
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      double at[kMaxCoordinates];
      read(first + l < moves ? first + l : first, at);
      for (std::uint32_t j = 0; j < d; ++j) coordinate[j * lanes_ + l] = at[j];
    }
    summary.add_sums(kLanes, coordinate, lanes_, factor, sums, lanes_);
  };
  add(1.0, [&](std::uint32_t m, double* at) { std::copy_n(proposals_[m].coordinate, d, at); });
  add(-1.0, [&](std::uint32_t m, double* at) { proposer.read_present(m, at); });
}

/// A proposal's sums over all data.
void FilterMoves::sum_proposals(const FilterChunk* chunks, const FilterParticles& particles, std::uint32_t moves,
                                bool pairs) {
  const auto over_window = [chunks](std::uint32_t lane, std::uint32_t r) {
    return chunks[lane / kLanes].sums[r * kLanes + lane % kLanes];
  };
  const std::uint32_t n = particles.n();
  for (std::uint32_t r = 0; r < kRows; ++r)
    for (std::uint32_t m = 0; m < moves; ++m) {
      const std::uint32_t at = r * n + proposals_[m].particle;
      const double before = pairs ? particles.sums[at] - over_window(moves + m, r) : particles.base[at];
      sums_[r * lanes_ + m] += before + over_window(m, r);
    }
}

/// Metropolis on prior x likelihood^exponent: how many are accepted.
std::uint32_t FilterMoves::accept(const Job& job, FilterParticles& particles, std::uint32_t moves, double exponent) {
  double* updated = particles.scratch_row(0);
  job.evidence.log_likelihood(moves, sums_, lanes_, updated);
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) {
    const Proposal& p = proposals_[m];
    const double change = exponent * (updated[m] - particles.log_likelihood[p.particle]) + p.log_correction;
    if (!(change > p.log_uniform)) continue;  // NaN too
    ++accepted;
    const FilterChunk& chunk = job.tools.chunks[m / kLanes];
    particles.log_likelihood[p.particle] = updated[m];
    for (std::uint32_t r = 0; r < kRows; ++r) {
      const double sum = sums_[r * lanes_ + m];
      particles.sums[r * particles.n() + p.particle] = sum;
      if (job.window.exact())
        particles.base[r * particles.n() + p.particle] = sum - chunk.sums[r * kLanes + m % kLanes];
    }
    particles.take_over(p.particle, chunk, m % kLanes, p.coordinate);
  }
  return accepted;
}

}  // namespace tiller
