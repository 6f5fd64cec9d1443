// Banks of filters beside those that learn, one for each parameter that may drift: whether it jumped, walks or stays.
//
// A drift that is estimated follows whatever a parameter does, and its rate does not say which of these it was. In a
// bank every lane has the parameters of the posterior's mean and a course of the drifting one (JumpBank); the lanes'
// likelihoods, the noise's scale integrated out, are compared. A bank begins once the posterior has taken its first
// data in, with what it knows then. Parameters that do not drift follow the posterior's mean, while that has settled.

#include <algorithm>
#include <cmath>

#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

namespace {

/// Number of values that the posterior's knowledge of the noise is worth where a bank begins.
constexpr double kNoiseWorth = 20.0;

void copy_lane(const FilterRows& rows, std::uint32_t states, std::uint32_t effect_states, std::uint32_t from,
               std::uint32_t to) {
  const auto copy = [&](double* data, std::uint32_t count) {
    for (std::uint32_t r = 0; r < count; ++r) data[r * rows.stride + to] = data[r * rows.stride + from];
  };
  copy(rows.state, states);
  copy(rows.covariance, triangle_rows(states));
  copy(rows.effect_state, effect_states);
}

}  // namespace

/// The cloud has been swept since it last changed, with all data in it.
bool FilterPosterior::settled() const { return moved_ >= n_ && exponent_ == 1.0; }

double FilterPosterior::weighted_mean(const double* row) const {
  double sum = 0.0;
  for (std::uint32_t k = 0; k < n_; ++k) sum += cloud_.weight[k] * row[k];
  return sum;
}

std::uint32_t FilterPosterior::drift_row(std::uint32_t drift) const {
  const std::uint32_t state = nx_ + disturbances_.drift_state(drift);
  return triangle_row(nf_, state, state);
}

/// After the tick.
void FilterPosterior::watch_jumps() {
  if (!banks_ || !settled() || tick_ < kEarly) return;
  if (!banks_begun_) begin_banks();
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) take_mean_law(i);
}

/// All lanes of all banks are the heaviest particle's filter at the cloud's mean and deviation of what drifts.
void FilterPosterior::begin_banks() {
  banks_begun_ = true;
  bank_evidence_.clear();
  bank_evidence_.believe(noise_scale_ * noise_scale_, kNoiseWorth);
  const std::uint32_t from = heaviest();
  const auto level = [](double* to, double value) { std::fill(to, to + kChunk, value); };
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) {
    const Chunk& chunk = bank_chunks_[i];
    for (std::uint32_t p = 0; p < np_; ++p) level(chunk.params + p * kChunk, cloud_.params[p * n_ + from]);
    const FilterRows all = carried_.filter;
    for (std::uint32_t r = 0; r < nf_; ++r) level(chunk.filter.state + r * kChunk, all.state[r * n_ + from]);
    for (std::uint32_t r = 0; r < triangle_; ++r)
      level(chunk.filter.covariance + r * kChunk, all.covariance[r * n_ + from]);
    for (std::uint32_t r = 0; r < ns_; ++r)
      level(chunk.filter.effect_state + r * kChunk, all.effect_state[r * n_ + from]);
    for (std::uint32_t j = 0; j < disturbances_.drifts(); ++j) spread_drift(chunk, j, from);
    level(chunk.sums + ScaleEvidence::kSquared * kChunk, 0.0);
    level(chunk.sums + ScaleEvidence::kLogs * kChunk, 0.0);
    const tiller_prior_t law = disturbances_.law_prior(disturbances_.coordinates() - 1);
    banks_[i].begin(law.a, law.b, 0.5 * (law.low + law.high), law.high);
  }
}

/// The lanes' drift, of one particle's filter so far, gets the cloud's mean, and what the particles disagree about.
void FilterPosterior::spread_drift(const Chunk& chunk, std::uint32_t drift, std::uint32_t from) {
  const std::uint32_t param = disturbances_.drift_param(drift);
  const tiller_prior_t& prior = config_->priors[param];
  double* const off = scratch_row(0);
  const double own = to_coordinate(prior, params_now()[param * n_ + from]);
  for (std::uint32_t k = 0; k < n_; ++k) off[k] = to_coordinate(prior, params_now()[param * n_ + k]) - own;
  const double mean = weighted_mean(off);
  for (std::uint32_t k = 0; k < n_; ++k) off[k] = (off[k] - mean) * (off[k] - mean);
  const double variance = weighted_mean(off) / (noise_scale_ * noise_scale_);
  for (std::uint32_t l = 0; l < kChunk; ++l) {
    chunk.filter.state[(nx_ + disturbances_.drift_state(drift)) * kChunk + l] += mean;
    chunk.filter.covariance[drift_row(drift) * kChunk + l] += variance;
  }
}

/// What a bank does not ask after is as the posterior has it on average. Other drifting parameters walk as they do
/// there; the bank's own in the lanes of walks alone.
void FilterPosterior::take_mean_law(std::uint32_t drift) {
  const Chunk& chunk = bank_chunks_[drift];
  const auto level = [](double* to, double value) { std::fill(to, to + kChunk, value); };
  for (std::uint32_t j = 0; j < cloud_.named; ++j) {
    const std::uint32_t i = cloud_.inferred[j];
    if (((config_->posterior.drift >> i) & 1u) != 0) continue;
    const double mean = weighted_mean(cloud_.coordinate + std::size_t{j} * n_);
    level(chunk.params + i * kChunk, from_coordinate(config_->priors[i], mean));
  }
  level(chunk.process_scale, weighted_mean(carried_.process_scale));
  for (std::uint32_t r = 0; r < disturbances_.law_rows(); ++r)
    level(chunk.law + r * kChunk, weighted_mean(carried_.law + std::size_t{r} * n_));
  double* const own = chunk.law + disturbances_.source_of(disturbances_.drift_state(drift)) * kChunk;
  level(own, 0.0);
  const double spread = prior_spread(config_->priors[disturbances_.drift_param(drift)]);
  for (std::uint32_t w = 0; w < JumpBank::kWalks; ++w) {
    const double rate = banks_[drift].walk_rate(w) * spread;
    own[1 + w] = rate * rate;
  }
}

/// The transition that is being taken in, as the particles take it.
void FilterPosterior::step_banks() {
  if (!banks_begun_) return;
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (!std::isnan(now_.transition.measured[k])) bank_evidence_.count(now_.weight);
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) {
    const Chunk& chunk = bank_chunks_[i];
    Step step;
    step.period_s = now_.transition.period_s;
    step.input = now_.transition.input;
    step.from = chunk.filter;
    step.params = {chunk.params, kChunk};
    step.process_scale = chunk.process_scale;
    step.law = {chunk.law, kChunk};
    step.history = input_history_;
    map_sensors(chunk, chunk.params, kChunk);
    predict_lanes(chunk, step);
    CorrectJob correct = correct_job(now_.transition.measured, chunk);
    correct.weight = now_.weight;
    correct.squared_error = chunk.sums + ScaleEvidence::kSquared * kChunk;
    correct.log_variance = chunk.sums + ScaleEvidence::kLogs * kChunk;
    filter_->correct(correct);
    if (banks_[i].tick()) open_jump(i);
  }
}

void FilterPosterior::weigh_bank(std::uint32_t drift, double* log_likelihood) const {
  bank_evidence_.log_likelihood(kChunk, bank_chunks_[drift].sums, kChunk, log_likelihood);
}

/// The deviation of a jump is the prior's: nothing is known of it but that the parameter lies where it may lie.
void FilterPosterior::open_jump(std::uint32_t drift) {
  double likelihood[kChunk];
  weigh_bank(drift, likelihood);
  if (!std::isfinite(likelihood[JumpBank::kStays])) {
    banks_begun_ = false;  // without a filter to compare with nothing is told
    return;
  }
  JumpBank& bank = banks_[drift];
  const Chunk& chunk = bank_chunks_[drift];
  const std::uint32_t to = bank.make_room(likelihood, elapsed_s_), from = bank.likeliest(likelihood);
  copy_lane(chunk.filter, nf_, ns_, from, to);
  for (std::uint32_t r = 0; r < rows_; ++r) chunk.sums[r * kChunk + to] = chunk.sums[r * kChunk + from];
  double& variance = chunk.filter.covariance[drift_row(drift) * kChunk + to];
  bank.open(to, from, {elapsed_s_, bank_drift(drift, to), variance});
  const double spread = prior_spread(config_->priors[disturbances_.drift_param(drift)]) / noise_scale_;
  variance += spread * spread;
}

double FilterPosterior::bank_drift(std::uint32_t drift, std::uint32_t lane) const {
  return bank_chunks_[drift].filter.state[(nx_ + disturbances_.drift_state(drift)) * kChunk + lane];
}

void FilterPosterior::report_jumps(PosteriorReport& report) const {
  for (std::uint32_t i = 0; i < disturbances_.drifts() && banks_begun_; ++i) {
    double likelihood[kChunk];
    weigh_bank(i, likelihood);
    report.drift_evidence[i] = banks_[i].walk_evidence(likelihood);
    report.jump_evidence[i] = banks_[i].jump_evidence(likelihood);
    const std::uint32_t lane = banks_[i].likeliest_jump(likelihood);
    if (lane == JumpBank::kNone) continue;
    const JumpBank::Jump& jump = banks_[i].jump(lane);
    const std::uint32_t param = disturbances_.drift_param(i);
    const double own = bank_chunks_[i].params[param * kChunk + lane];
    const double after = disturbances_.drifted(param, own, bank_drift(i, lane));
    const double variance =
        jump.variance + std::fmax(0.0, bank_chunks_[i].filter.covariance[drift_row(i) * kChunk + lane]);
    const bool logarithmic = config_->priors[param].kind == tiller_prior_log_normal;
    report.jump_age_s[i] = elapsed_s_ - jump.time_s;
    report.jump_by[i] = after - disturbances_.drifted(param, own, jump.before);
    report.jump_sd[i] = noise_scale_ * std::sqrt(variance) * (logarithmic ? after : 1.0);
  }
}

}  // namespace tiller
