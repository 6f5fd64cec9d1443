// Banks of filters beside those that learn, one for each parameter that may drift: whether it jumped, walks or stays.
//
// A drift that is estimated follows whatever a parameter does, and its rate does not say which of these it was. In a
// bank every lane has a course of the drifting parameter (JumpBank), and all parameters that are learnt as states; the
// lanes' likelihoods, the noise's scale integrated out, are compared. A bank begins once the posterior has taken its
// first data in, with what it knows then: linear in the parameters, it would not do with what the prior leaves open.

#include <algorithm>
#include <cmath>

#include "posterior/filter/filter_posterior.hpp"
#include "rollout/attitude.hpp"

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

std::uint32_t FilterPosterior::bank_state(std::uint32_t drift) const {
  return nx_ + bank_states_->drift_state(bank_states_->drift_of(disturbances_.drift_param(drift)));
}

double& FilterPosterior::bank_variance(std::uint32_t drift, std::uint32_t lane) const {
  const Chunk& chunk = bank_chunks_[drift];
  return chunk.filter.covariance[triangle_row(chunk.nf, bank_state(drift), bank_state(drift)) * kChunk + lane];
}

/// After the tick.
void FilterPosterior::watch_jumps() {
  if (!banks_ || !settled() || tick_ < kEarly) return;
  if (!banks_begun_) begin_banks();
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) take_mean_law(i);
}

void FilterPosterior::begin_banks() {
  banks_begun_ = true;
  bank_evidence_.clear();
  bank_evidence_.believe(noise_scale_ * noise_scale_, kNoiseWorth);
  bank_states_->take_sizes(disturbances_);
  const tiller_prior_t law = disturbances_.law_prior(disturbances_.coordinates() - 1);
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) {
    begin_lanes(bank_chunks_[i]);
    banks_[i].begin(0.5 * (law.low + law.high), law.high);  // the lower half is one that stays
  }
}

/// The row of a bank's state in the particles' filters; nf_: they have none.
std::uint32_t FilterPosterior::carried_row(std::uint32_t state) const {
  const std::uint32_t shared = nx_ + bank_states_->states() - bank_states_->drifts();
  if (state < shared) return state;
  const std::uint32_t drift = disturbances_.drift_of(bank_states_->drift_param(state - shared));
  return drift < disturbances_.drifts() ? nx_ + disturbances_.drift_state(drift) : nf_;
}

/// How one particle differs from the filter of another, in a bank's states.
void FilterPosterior::differ_in_bank(std::uint32_t k, std::uint32_t about, double* off) const {
  const std::uint32_t shared = nx_ + bank_states_->states() - bank_states_->drifts();
  const double* const state = carried_.filter.state;
  for (std::uint32_t r = 0; r < shared; ++r) off[r] = state[r * n_ + k] - state[r * n_ + about];
  for_quaternions(quaternions_, [&](std::uint32_t first) {
    const double* q = state + first * n_;
    const Vector3<double> d = attitude_difference(read_quaternion(q + k, n_), read_quaternion(q + about, n_));
    write_quaternion({0.0, d.x, d.y, d.z}, off + first);
  });
  for (std::uint32_t j = 0; j < bank_states_->drifts(); ++j) {
    const std::uint32_t param = bank_states_->drift_param(j);
    const tiller_prior_t& prior = config_->priors[param];
    off[shared + j] =
        to_coordinate(prior, params_now()[param * n_ + k]) - to_coordinate(prior, cloud_.params[param * n_ + about]);
  }
}

/// All lanes are the particles' mean, with what their filters leave open and what they disagree about. Attitudes stay
/// those of the heaviest.
void FilterPosterior::begin_lanes(const Chunk& chunk) const {
  const std::uint32_t about = heaviest(), nf = chunk.nf;
  const double between = 1.0 / (noise_scale_ * noise_scale_);
  const auto level = [](double* row) { std::fill(row, row + kChunk, *row); };
  double mean[kMaxFilterStates] = {}, off[kMaxFilterStates];
  std::fill(chunk.filter.covariance, chunk.filter.covariance + triangle_rows(nf) * kChunk, 0.0);
  for (std::uint32_t k = 0; k < n_; ++k) {
    differ_in_bank(k, about, off);
    for (std::uint32_t r = 0; r < nf; ++r) mean[r] += cloud_.weight[k] * off[r];
  }
  for (std::uint32_t k = 0; k < n_; ++k) {
    differ_in_bank(k, about, off);
    for (std::uint32_t r = 0; r < nf; ++r)
      for (std::uint32_t c = r; c < nf; ++c) {
        const std::uint32_t row = std::min(carried_row(r), carried_row(c)),
                            column = std::max(carried_row(r), carried_row(c));
        double own = (off[r] - mean[r]) * (off[c] - mean[c]) * between;
        if (column < nf_) own += carried_.filter.covariance[triangle_row(nf_, row, column) * n_ + k];
        chunk.filter.covariance[triangle_row(nf, r, c) * kChunk] += cloud_.weight[k] * own;
      }
  }
  for_quaternions(quaternions_, [&](std::uint32_t first) { std::fill(mean + first, mean + first + 4, 0.0); });
  for (std::uint32_t r = 0; r < nf; ++r) {
    const bool is_param = r >= nx_ + bank_states_->states() - bank_states_->drifts();
    chunk.filter.state[r * kChunk] = mean[r] + (is_param ? 0.0 : carried_.filter.state[r * n_ + about]);
    level(chunk.filter.state + r * kChunk);
  }
  for (std::uint32_t r = 0; r < triangle_rows(nf); ++r) level(chunk.filter.covariance + r * kChunk);
  for (std::uint32_t r = 0; r < ns_; ++r) {
    chunk.filter.effect_state[r * kChunk] = carried_.filter.effect_state[r * n_ + about];
    level(chunk.filter.effect_state + r * kChunk);
  }
  for (std::uint32_t p = 0; p < np_; ++p) {
    chunk.params[p * kChunk] = cloud_.params[p * n_ + about];
    level(chunk.params + p * kChunk);
  }
  std::fill(chunk.sums, chunk.sums + rows_ * kChunk, 0.0);
}

/// What a bank does not ask after is as the posterior has it on average. Other drifting parameters walk as they do
/// there; the bank's own in the lanes of walks alone.
void FilterPosterior::take_mean_law(std::uint32_t drift) {
  const Chunk& chunk = bank_chunks_[drift];
  const auto level = [](double* to, double value) { std::fill(to, to + kChunk, value); };
  const auto mean_law = [&](std::uint32_t to, std::uint32_t from) {
    level(chunk.law + to * kChunk, weighted_mean(carried_.law + std::size_t{from} * n_));
  };
  for (std::uint32_t j = 0; j < cloud_.named; ++j) {  // a sensor's, or one that there is no room for
    const std::uint32_t i = cloud_.inferred[j];
    if (bank_states_->drift_of(i) < bank_states_->drifts()) continue;
    const double mean = weighted_mean(cloud_.coordinate + std::size_t{j} * n_);
    level(chunk.params + i * kChunk, from_coordinate(config_->priors[i], mean));
  }
  level(chunk.process_scale, weighted_mean(carried_.process_scale));
  const std::uint32_t forces = bank_states_->sources() - bank_states_->drifts();
  for (std::uint32_t s = 0; s < forces; ++s) mean_law(s, s);
  mean_law(bank_states_->rate_row(), disturbances_.rate_row());
  mean_law(bank_states_->turn_row(), disturbances_.turn_row());
  for (std::uint32_t j = 0; j < bank_states_->drifts(); ++j) {
    const std::uint32_t other = disturbances_.drift_of(bank_states_->drift_param(j));
    double* const row = chunk.law + (forces + j) * kChunk;
    level(row, 0.0);
    if (other < disturbances_.drifts() && other != drift) mean_law(forces + j, forces + other);
    if (other != drift) continue;
    const double spread = prior_spread(config_->priors[disturbances_.drift_param(drift)]);
    for (std::uint32_t w = 0; w < JumpBank::kWalks; ++w) {
      const double rate = banks_[drift].walk_rate(w) * spread;
      row[1 + w] = rate * rate;
    }
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
  copy_lane(chunk.filter, chunk.nf, ns_, from, to);
  for (std::uint32_t r = 0; r < rows_; ++r) chunk.sums[r * kChunk + to] = chunk.sums[r * kChunk + from];
  double& variance = bank_variance(drift, to);
  bank.open(to, from, {elapsed_s_, bank_drift(drift, to), variance});
  const double spread = prior_spread(config_->priors[disturbances_.drift_param(drift)]) / noise_scale_;
  variance += spread * spread;
}

double FilterPosterior::bank_drift(std::uint32_t drift, std::uint32_t lane) const {
  return bank_chunks_[drift].filter.state[bank_state(drift) * kChunk + lane];
}

/// All banks have seen the same data, so that their likelihoods compare: where another parameter's jump explains the
/// data better than this one as it was, this one is judged beside that jump. A load that is picked up is no friction
/// then.
void FilterPosterior::report_jumps(PosteriorReport& report) const {
  if (!banks_begun_) return;
  const std::uint32_t drifts = disturbances_.drifts();
  double stays[TILLER_MAX_DRIFTS], walks[TILLER_MAX_DRIFTS], jumps[TILLER_MAX_DRIFTS];
  for (std::uint32_t i = 0; i < drifts; ++i) {
    double likelihood[kChunk];
    weigh_bank(i, likelihood);
    stays[i] = likelihood[JumpBank::kStays];
    walks[i] = stays[i] + banks_[i].walk_evidence(likelihood);
    jumps[i] = stays[i] + banks_[i].jump_evidence(likelihood);
    report_last_jump(i, banks_[i].likeliest_jump(likelihood), report);
  }
  for (std::uint32_t i = 0; i < drifts; ++i) {
    double none = stays[i];
    for (std::uint32_t j = 0; j < drifts; ++j)
      if (j != i && jumps[j] > std::max(walks[j], stays[j])) none = std::max(none, jumps[j]);
    report.drift_evidence[i] = walks[i] - none;
    report.jump_evidence[i] = jumps[i] - none;
  }
}

void FilterPosterior::report_last_jump(std::uint32_t drift, std::uint32_t lane, PosteriorReport& report) const {
  if (lane == JumpBank::kNone) return;
  const JumpBank::Jump& jump = banks_[drift].jump(lane);
  const std::uint32_t param = disturbances_.drift_param(drift);
  const double own = bank_chunks_[drift].params[param * kChunk + lane];
  const double after = disturbances_.drifted(param, own, bank_drift(drift, lane));
  const double variance = jump.variance + std::fmax(0.0, bank_variance(drift, lane));
  const bool logarithmic = config_->priors[param].kind == tiller_prior_log_normal;
  report.jump_age_s[drift] = elapsed_s_ - jump.time_s;
  report.jump_by[drift] = after - disturbances_.drifted(param, own, jump.before);
  report.jump_sd[drift] = noise_scale_ * std::sqrt(variance) * (logarithmic ? after : 1.0);
}

}  // namespace tiller
