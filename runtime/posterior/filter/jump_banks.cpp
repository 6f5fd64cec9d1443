#include "posterior/filter/jump_banks.hpp"

#include <algorithm>
#include <cmath>

#include "core/bits.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

namespace {

/// Number of values that the posterior's knowledge of the noise is worth where a bank begins.
constexpr double kNoiseWorth = 20.0;

/// Parameters that a bank has as states: those that drift, and of the others as many as there is room for. What a
/// filter takes for known it makes up for in what may change.
std::uint64_t bank_params(const tiller_config_t& config, std::uint32_t room) {
  std::uint64_t chosen = config.posterior.drift;
  for (std::uint32_t i = 0; i < config.param_count && bit_count(chosen) < room; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) chosen |= (std::uint64_t{1} << i) & ~sensor_rows(config);
  return chosen;
}

void copy_lane(const FilterRows& rows, std::uint32_t states, std::uint32_t effect_states, std::uint32_t from,
               std::uint32_t to) {
  const auto copy = [&](double* data, std::uint32_t count) {
    for (std::uint32_t r = 0; r < count; ++r) data[r * rows.stride + to] = data[r * rows.stride + from];
  };
  copy(rows.state, states);
  copy(rows.covariance, triangle_rows(states));
  copy(rows.effect_state, effect_states);
}

/// All lanes have it.
void level(double* row, double value) { std::fill(row, row + FilterChunk::kLanes, value); }

}  // namespace

std::uint64_t sensor_rows(const tiller_config_t& config) {
  std::uint64_t rows = 0;
  std::uint32_t row = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    for (int i = 0; i < info.param_count; ++i, ++row)
      if (info.port == PortKind::sensor) rows |= std::uint64_t{1} << row;
  }
  return rows;
}

JumpBanks* JumpBanks::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                              const RolloutTable& table, const DisturbanceStates& disturbances, std::uint32_t d) {
  const std::uint32_t drifts = disturbances.drifts(), nx = config.model->state_count;
  if (drifts == 0) return nullptr;
  auto* const b = arena.take<JumpBanks>(1);
  auto* const banks = arena.take<JumpBank>(drifts);
  const std::uint32_t room = kMaxFilterStates - nx - disturbances.states() + drifts;
  const DisturbanceStates states(config, setup, table, bank_params(config, room));
  const FilterChunk* const chunks =
      FilterChunk::lay_out(arena, drifts, config, setup, states, b ? &b->states_ : nullptr, d);
  if (!b) return nullptr;
  b->config_ = &config;
  b->nx_ = nx;
  b->drifts_ = drifts;
  for (std::uint32_t i = 0; i < drifts; ++i) b->param_[i] = disturbances.drift_param(i);
  b->states_ = states;
  b->evidence_ = ScaleEvidence(config);
  b->chunks_ = chunks;
  b->banks_ = banks;
  return b;
}

double& JumpBanks::variance(std::uint32_t drift, std::uint32_t lane) const {
  const FilterChunk& chunk = chunks_[drift];
  return chunk.filter.covariance[triangle_row(chunk.nf, state_of(drift), state_of(drift)) * kLanes + lane];
}

double JumpBanks::drift_at(std::uint32_t drift, std::uint32_t lane) const {
  return chunks_[drift].filter.state[state_of(drift) * kLanes + lane];
}

void JumpBanks::follow(const FilterParticles& particles, double noise_scale) {
  if (!begun_) begin(particles, noise_scale);
  for (std::uint32_t i = 0; i < drifts_; ++i) take_mean_law(i, particles);
}

void JumpBanks::begin(const FilterParticles& particles, double noise_scale) {
  const DisturbanceStates& carried = *particles.disturbances;
  begun_ = true;
  evidence_.clear();
  evidence_.believe(noise_scale * noise_scale, kNoiseWorth);
  states_.take_sizes(carried);
  const tiller_prior_t law = carried.law_prior(carried.coordinates() - 1);
  for (std::uint32_t i = 0; i < drifts_; ++i) {
    begin_lanes(chunks_[i], particles, noise_scale);
    banks_[i].begin(0.5 * (law.low + law.high), law.high);  // the lower half is one that stays
  }
}

/// The row of a bank's state in the particles' filters; nf: they have none.
std::uint32_t JumpBanks::carried_row(const FilterParticles& particles, std::uint32_t state) const {
  if (state < first_param()) return state;
  const DisturbanceStates& carried = *particles.disturbances;
  const std::uint32_t drift = carried.drift_of(states_.drift_param(state - first_param()));
  return drift < carried.drifts() ? nx_ + carried.drift_state(drift) : particles.nf;
}

/// How one particle differs from the filter of another, in a bank's states.
void JumpBanks::differ(const FilterParticles& particles, std::uint32_t i, std::uint32_t about, double* off) const {
  const std::uint32_t n = particles.n();
  particles.differ(i, about, off);
  for (std::uint32_t j = 0; j < states_.drifts(); ++j) {
    const std::uint32_t param = states_.drift_param(j);
    const tiller_prior_t& prior = config_->priors[param];
    off[first_param() + j] = to_coordinate(prior, particles.params_now()[param * n + i]) -
                             to_coordinate(prior, particles.cloud.params[param * n + about]);
  }
}

/// All lanes are the particles' mean, with what their filters leave open and what they disagree about. Attitudes stay
/// those of the heaviest.
void JumpBanks::begin_lanes(const FilterChunk& chunk, const FilterParticles& particles, double noise_scale) const {
  const std::uint32_t about = particles.heaviest(), nf = chunk.nf;
  const double between = 1.0 / (noise_scale * noise_scale);
  double mean[kMaxFilterStates] = {}, off[kMaxFilterStates];
  std::fill(chunk.filter.covariance, chunk.filter.covariance + triangle_rows(nf) * kLanes, 0.0);
  for (std::uint32_t k = 0; k < particles.n(); ++k) {
    differ(particles, k, about, off);
    for (std::uint32_t r = 0; r < nf; ++r) mean[r] += particles.weight(k) * off[r];
  }
  for (std::uint32_t k = 0; k < particles.n(); ++k) {
    differ(particles, k, about, off);
    for (std::uint32_t r = 0; r < nf; ++r)
      for (std::uint32_t c = r; c < nf; ++c) {
        const std::uint32_t one = carried_row(particles, r), other = carried_row(particles, c);
        double own = (off[r] - mean[r]) * (off[c] - mean[c]) * between;
        if (std::max(one, other) < particles.nf)
          own += particles.covariance(std::min(one, other), std::max(one, other))[k];
        chunk.filter.covariance[triangle_row(nf, r, c) * kLanes] += particles.weight(k) * own;
      }
  }
  for_quaternions(config_->model->quaternion_mask,
                  [&](std::uint32_t first) { std::fill(mean + first, mean + first + 4, 0.0); });
  for (std::uint32_t r = 0; r < nf; ++r)
    level(chunk.filter.state + r * kLanes, mean[r] + (r < first_param() ? particles.state(r)[about] : 0.0));
  for (std::uint32_t r = 0; r < triangle_rows(nf); ++r) {
    double* const row = chunk.filter.covariance + r * kLanes;
    level(row, *row);
  }
  for (std::uint32_t r = 0; r < particles.ns; ++r)
    level(chunk.filter.effect_state + r * kLanes, particles.effect_state(r)[about]);
  for (std::uint32_t p = 0; p < particles.cloud.np; ++p)
    level(chunk.params + p * kLanes, particles.cloud.params[p * particles.n() + about]);
  chunk.clear_sums();
}

/// What a bank does not ask after is as the posterior has it on average. Other drifting parameters walk as they do
/// there; the bank's own in the lanes of walks alone.
void JumpBanks::take_mean_law(std::uint32_t drift, const FilterParticles& particles) {
  const FilterChunk& chunk = chunks_[drift];
  const Cloud& cloud = particles.cloud;
  const DisturbanceStates& carried = *particles.disturbances;
  const auto mean_law = [&](std::uint32_t to, std::uint32_t from) {
    level(chunk.law + to * kLanes, particles.mean(particles.law(from)));
  };
  for (std::uint32_t j = 0; j < cloud.named; ++j) {  // a sensor's, or one that there is no room for
    const std::uint32_t i = cloud.inferred[j];
    if (states_.drift_of(i) < states_.drifts()) continue;
    const double mean = particles.mean(cloud.coordinate + std::size_t{j} * cloud.n);
    level(chunk.params + i * kLanes, from_coordinate(config_->priors[i], mean));
  }
  level(chunk.process_scale, particles.mean(particles.process_scale));
  for (std::uint32_t s = 0; s < forces(); ++s) mean_law(s, s);
  mean_law(states_.rate_row(), carried.rate_row());
  mean_law(states_.turn_row(), carried.turn_row());
  for (std::uint32_t j = 0; j < states_.drifts(); ++j) {
    const std::uint32_t other = carried.drift_of(states_.drift_param(j));
    double* const row = chunk.law + (forces() + j) * kLanes;
    level(row, 0.0);
    if (other < carried.drifts() && other != drift) mean_law(forces() + j, forces() + other);
    if (other != drift) continue;
    const double spread = prior_spread(config_->priors[param_[drift]]);
    for (std::uint32_t w = 0; w < JumpBank::kWalks; ++w) {
      const double rate = banks_[drift].walk_rate(w) * spread;
      row[1 + w] = rate * rate;
    }
  }
}

void JumpBanks::step(const LaneFilter& filter, const Observation& seen, double elapsed_s, double noise_scale) {
  if (!begun_) return;
  evidence_.count(seen.measured, filter.ny(), seen.weight);
  for (std::uint32_t i = 0; i < drifts_; ++i) {
    const FilterChunk& chunk = chunks_[i];
    filter.step_own(chunk, seen, chunk.filter);
    if (banks_[i].tick()) open_jump(i, filter.ns(), elapsed_s, noise_scale);
  }
}

void JumpBanks::weigh(std::uint32_t drift, double* log_likelihood) const {
  evidence_.log_likelihood(kLanes, chunks_[drift].sums, kLanes, log_likelihood);
}

/// The deviation of a jump is the prior's: nothing is known of it but that the parameter lies where it may lie.
void JumpBanks::open_jump(std::uint32_t drift, std::uint32_t effect_states, double elapsed_s, double noise_scale) {
  double likelihood[kLanes];
  weigh(drift, likelihood);
  if (!std::isfinite(likelihood[JumpBank::kStays])) {
    stop();  // without a filter to compare with nothing is told
    return;
  }
  JumpBank& bank = banks_[drift];
  const FilterChunk& chunk = chunks_[drift];
  const std::uint32_t to = bank.make_room(likelihood, elapsed_s), from = bank.likeliest(likelihood);
  copy_lane(chunk.filter, chunk.nf, effect_states, from, to);
  for (std::uint32_t r = 0; r < ScaleEvidence::kRows; ++r) chunk.sums[r * kLanes + to] = chunk.sums[r * kLanes + from];
  double& spread_square = variance(drift, to);
  bank.open(to, from, {elapsed_s, drift_at(drift, to), spread_square});
  const double spread = prior_spread(config_->priors[param_[drift]]) / noise_scale;
  spread_square += spread * spread;
}

/// All banks have seen the same data, so that their likelihoods compare: where another parameter's jump explains the
/// data better than this one as it was, this one is judged beside that jump. A load that is picked up is no friction
/// then.
void JumpBanks::report(double elapsed_s, double noise_scale, PosteriorReport& report) const {
  if (!begun_) return;
  double stays[TILLER_MAX_DRIFTS], walks[TILLER_MAX_DRIFTS], jumps[TILLER_MAX_DRIFTS];
  for (std::uint32_t i = 0; i < drifts_; ++i) {
    double likelihood[kLanes];
    weigh(i, likelihood);
    stays[i] = likelihood[JumpBank::kStays];
    walks[i] = stays[i] + banks_[i].walk_evidence(likelihood);
    jumps[i] = stays[i] + banks_[i].jump_evidence(likelihood);
    report_last(i, banks_[i].likeliest_jump(likelihood), elapsed_s, noise_scale, report);
  }
  for (std::uint32_t i = 0; i < drifts_; ++i) {
    double none = stays[i];
    for (std::uint32_t j = 0; j < drifts_; ++j)
      if (j != i && jumps[j] > std::max(walks[j], stays[j])) none = std::max(none, jumps[j]);
    report.drift_evidence[i] = walks[i] - none;
    report.jump_evidence[i] = jumps[i] - none;
  }
}

void JumpBanks::report_last(std::uint32_t drift, std::uint32_t lane, double elapsed_s, double noise_scale,
                            PosteriorReport& report) const {
  if (lane == JumpBank::kNone) return;
  const JumpBank::Jump& jump = banks_[drift].jump(lane);
  const std::uint32_t param = param_[drift];
  const double own = chunks_[drift].params[param * kLanes + lane];
  const double after = states_.drifted(param, own, drift_at(drift, lane));
  const double square = jump.variance + std::fmax(0.0, variance(drift, lane));
  const bool logarithmic = config_->priors[param].kind == tiller_prior_log_normal;
  report.jump_age_s[drift] = elapsed_s - jump.time_s;
  report.jump_by[drift] = after - states_.drifted(param, own, jump.before);
  report.jump_sd[drift] = noise_scale * std::sqrt(square) * (logarithmic ? after : 1.0);
}

}  // namespace tiller
