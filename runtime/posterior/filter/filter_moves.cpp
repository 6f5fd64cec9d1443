#include "posterior/filter/filter_moves.hpp"

#include <cmath>
#include <cstring>

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
  propose(cloud, job.tick, tempering.cursor(), moves, proposals_, guided(cloud) ? &guides : nullptr);
  load_lanes(job.tools.chunks, particles, moves, pairs);
  const std::uint32_t lanes = pairs ? 2 * moves : moves;
  for_each_chunk(job.hooks, (lanes + kLanes - 1) / kLanes, true,
                 [&](std::uint32_t c) { rerun(job, job.tools.chunks[c]); });
  sum_past(job.past.summary(), cloud, moves);
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

/// The proposals in lanes 0..moves-1, with pairs the present parameters behind them. The last chunk is filled up with
/// copies of the first lane.
void FilterMoves::load_lanes(const FilterChunk* chunks, const FilterParticles& particles, std::uint32_t moves,
                             bool pairs) const {
  std::uint32_t lane = 0;
  const auto place = [&](const double* coordinate) {
    particles.place(chunks[lane / kLanes], lane % kLanes, coordinate);
    ++lane;
  };
  for (std::uint32_t m = 0; m < moves; ++m) place(proposals_[m].coordinate);
  for (std::uint32_t m = 0; m < moves && pairs; ++m) {
    double present[kMaxCoordinates];
    for (std::uint32_t j = 0; j < particles.cloud.d; ++j)
      present[j] = particles.cloud.coordinate[j * particles.n() + proposals_[m].particle];
    place(present);
  }
  while (lane % kLanes != 0) place(proposals_[0].coordinate);
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

/// The summary's log density of each proposal less that of the present parameters.
void FilterMoves::sum_past(const FilterSummary& summary, const Cloud& cloud, std::uint32_t moves) {
  const std::uint32_t lanes = round_up(moves, kLanes);
  std::memset(sums_, 0, sizeof(double) * kRows * lanes_);
  const auto add = [&](double factor, const auto& coordinate) {
    for (std::uint32_t m = 0; m < lanes; ++m)
      for (std::uint32_t j = 0; j < cloud.d; ++j)
        coordinate_[j * lanes_ + m] = coordinate(proposals_[m < moves ? m : 0], j);
    summary.add_sums(lanes, coordinate_, lanes_, factor, sums_, lanes_);
  };
  add(1.0, [](const Proposal& p, std::uint32_t j) { return p.coordinate[j]; });
  add(-1.0, [&](const Proposal& p, std::uint32_t j) { return cloud.coordinate[j * cloud.n + p.particle]; });
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
