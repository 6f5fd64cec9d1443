#include "posterior/transition/transition_moves.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "posterior/proposals.hpp"

namespace tiller {

namespace {

/// Random numbers of the steps that lead out of a degenerate cloud, apart from the scouts' of the same stream.
constexpr std::uint64_t kWidening = std::uint64_t{1} << 60;

/// Share of the moves that are drawn independently from the cloud's own Student-t.
constexpr double kIndependent = 0.5;

}  // namespace

TransitionMoves TransitionMoves::lay_out(Arena& arena, const TransitionParticles& particles) {
  const Cloud& cloud = particles.cloud;
  TransitionMoves m;
  m.lanes_ = lanes_of(*cloud.config);
  const std::size_t lanes = m.lanes_;
  m.change_ = arena.take<double>(lanes);
  m.uniform_ = arena.take<double>(lanes);
  m.params_ = arena.take<float>(cloud.np * lanes);
  m.coordinate_ = arena.take<double>(cloud.d * lanes);
  m.present_ = arena.take<double>(cloud.d * lanes);
  m.ring_ = arena.take<double>(particles.rows * lanes);
  m.total_ = arena.take<double>(particles.rows * lanes);
  m.likelihood_ = arena.take<double>(lanes);
  m.flat_prior_ = !cloud.prior.is_mixture();
  for (std::uint32_t j = 0; j < cloud.d; ++j)
    m.flat_prior_ = m.flat_prior_ && cloud.prior.marginal(j).kind == tiller_prior_uniform;
  return m;
}

void TransitionMoves::move(const TransitionData& data, const ResidualSummary& summary, Tempering& tempering,
                           std::uint32_t moves) {
  const Cloud& cloud = data.particles.cloud;
  const std::uint32_t lanes = round_up(moves, 16);
  propose(cloud, tempering.cursor(), moves);
  load_params(data.particles, lanes);
  for (std::uint32_t r = 0; r < data.particles.rows; ++r) std::memset(ring_ + r * lanes_, 0, sizeof(double) * lanes);
  data.sums.sum({params_, lanes_}, lanes, data.ring.begin(), data.ring.end(), ring_, lanes_);
  tempering.note_moves(cloud, moves, accept(data, summary, tempering, moves));
}

void TransitionMoves::load_params(const TransitionParticles& particles, std::uint32_t lanes) const {
  const Cloud& cloud = particles.cloud;
  for (std::uint32_t i = 0; i < cloud.np; ++i)
    for (std::uint32_t m = 0; m < lanes; ++m) params_[i * lanes_ + m] = particles.params[i * cloud.n];
  for (std::uint32_t j = 0; j < cloud.d; ++j) {
    const std::uint32_t i = cloud.inferred[j];
    for (std::uint32_t m = 0; m < lanes; ++m)
      params_[i * lanes_ + m] =
          static_cast<float>(from_coordinate(cloud.config->priors[i], coordinate_[j * lanes_ + m]));
  }
}

void TransitionMoves::propose(const Cloud& cloud, std::uint32_t cursor, std::uint32_t moves) {
  const std::uint32_t d = cloud.d;
  double low[kMaxCoordinates], high[kMaxCoordinates];
  for (std::uint32_t j = 0; j < d; ++j) {
    low[j] = cloud.prior.low(j);
    high[j] = cloud.prior.high(j);
  }
  ProposalJob job;
  job.d = d;
  job.n = cloud.n;
  job.cursor = cursor;
  job.moves = moves;
  std::uint32_t keys[kProposalWords + 1][2];
  ++batch_;
  for (std::uint32_t row = 0; row < kProposalWords; row += 2) {
    const Philox::Words words = Philox::draw(cloud.config->seed, batch_ * 64 + row, std::uint64_t{kRngMove} << 32);
    std::memcpy(keys[row], words.w, sizeof words.w);
  }
  job.keys = keys;
  job.independent = kIndependent;
  job.coordinate = cloud.coordinate;
  job.weight = cloud.weight;
  job.low = low;
  job.high = high;
  job.present = present_;
  job.proposed = coordinate_;
  job.log_change = change_;
  job.log_uniform = uniform_;
  job.stride = lanes_;
  bool whole = true;
  job.whole = &whole;
  transition_table().propose(job);
  if (!whole) inflate(cloud, moves);
  const double scouts = cloud.config->posterior.prior_proposal_fraction;
  if (flat_prior_ && !(scouts > 0.0)) return;
  for (std::uint32_t m = 0; m < moves; ++m) {
    double present[kMaxCoordinates], proposed[kMaxCoordinates];
    for (std::uint32_t j = 0; j < d; ++j) {
      present[j] = present_[j * lanes_ + m];
      proposed[j] = coordinate_[j * lanes_ + m];
    }
    Rng rng(cloud.config->seed, kRngScout, batch_ * 4096 + m);
    if (scouts > 0.0 && rng.uniform() < scouts) {
      // an independent draw from the prior, whose density cancels out of the ratio
      cloud.prior.draw_one(rng, proposed);
      for (std::uint32_t j = 0; j < d; ++j) coordinate_[j * lanes_ + m] = proposed[j];
      change_[m] = 0.0;
    } else if (!flat_prior_) {
      change_[m] += cloud.prior.log_density(proposed) - cloud.prior.log_density(present);
    }
  }
}

/// Every other proposal is a step of one coordinate.
void TransitionMoves::inflate(const Cloud& cloud, std::uint32_t moves) {
  for (std::uint32_t m = 1; m < moves; m += 2) {
    Rng rng(cloud.config->seed, kRngScout, kWidening + batch_ * 4096 + m);
    const auto [moving, length] = draw_coordinate_step(cloud.prior, rng);
    for (std::uint32_t j = 0; j < cloud.d; ++j) {
      const double present = present_[j * lanes_ + m];
      coordinate_[j * lanes_ + m] = j == moving ? present + length : present;
    }
    const double to = coordinate_[moving * lanes_ + m];
    const bool inside = to >= cloud.prior.low(moving) && to <= cloud.prior.high(moving);
    if (!inside) coordinate_[moving * lanes_ + m] = present_[moving * lanes_ + m];
    change_[m] = inside ? 0.0 : -INFINITY;
  }
}

/// Metropolis on prior x likelihood^exponent: how many are accepted.
std::uint32_t TransitionMoves::accept(const TransitionData& data, const ResidualSummary& summary,
                                      const Tempering& tempering, std::uint32_t moves) {
  TransitionParticles& p = data.particles;
  Cloud& cloud = p.cloud;
  const std::uint32_t n = cloud.n, lanes = round_up(moves, 16), cursor = tempering.cursor(), wrap = n - cursor;
  for (std::uint32_t r = 0; r < p.rows; ++r) {
    const double *total = p.total + r * n + cursor, *ring = p.ring + r * n + cursor;
    const double* proposed = ring_ + r * lanes_;
    double* to = total_ + r * lanes_;
    const std::uint32_t head = std::min(moves, wrap);
    for (std::uint32_t m = 0; m < head; ++m) to[m] = total[m] - ring[m] + proposed[m];
    for (std::uint32_t m = head; m < moves; ++m) to[m] = *(total + m - n) - *(ring + m - n) + proposed[m];
    for (std::uint32_t m = moves; m < lanes; ++m) to[m] = 0.0;
  }
  summary.add_sums(lanes, coordinate_, 1.0, total_, lanes_);
  summary.add_sums(lanes, present_, -1.0, total_, lanes_);
  data.evidence.log_likelihood(lanes, total_, lanes_, likelihood_);
  std::uint32_t accepted = 0;
  for (std::uint32_t m = 0; m < moves; ++m) {
    const std::uint32_t i = m < wrap ? cursor + m : m - wrap;
    const double change = likelihood_[m] - p.log_likelihood[i];
    if (!(tempering.exponent() * change + change_[m] > uniform_[m])) continue;  // NaN is refused
    ++accepted;
    for (std::uint32_t j = 0; j < cloud.d; ++j) {
      const std::uint32_t row = cloud.inferred[j];
      const double to = coordinate_[j * lanes_ + m];
      cloud.coordinate[j * n + i] = to;
      cloud.params[row * n + i] = from_coordinate(cloud.config->priors[row], to);
      p.params[row * n + i] = params_[row * lanes_ + m];
    }
    for (std::uint32_t r = 0; r < p.rows; ++r) {
      p.total[r * n + i] = total_[r * lanes_ + m];
      p.ring[r * n + i] = ring_[r * lanes_ + m];
    }
    p.log_likelihood[i] = likelihood_[m];
  }
  return accepted;
}

}  // namespace tiller
