// The tick: predict, correct, reweight, move, retire.

#include "posterior/filter/filter_posterior.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/attitude_measurement.hpp"
#include "posterior/tasks.hpp"

namespace tiller {

namespace {

constexpr std::uint32_t kRows = FilterParticles::kRows, kLanes = FilterChunk::kLanes;
/// Number of values that the earlier knowledge of the noise is worth once the robot has changed.
constexpr double kNoiseWorth = 20.0;
/// Ticks in which a posterior that has begun takes everything for news: what it has not learnt yet looks like shoves,
/// and a window that is cut while the cloud is wide is summed up badly.
constexpr std::uint64_t kNewcomer = 128;

}  // namespace

void FilterPosterior::reset() {
  particles_.draw_prior();
  particles_.clear_sums();
  evidence_.believe_configuration();
  evidence_.clear();
  window_.clear();
  past_.clear();
  disturbances_.clear();
  moves_.reset(particles_.cloud, disturbances_);
  tempering_.reset();
  noise_ = {};
  elapsed_s_ = 0.0;
  started_ = false;
  tick_ = 0;
  gate_.begin();
  shoves_.reset(ShoveWatch::longest(*config_));
  learnt_ticks_ = 0;
  if (jumps_) jumps_->stop();
  if (adequacy_) adequacy_->reset();
  start_.reset(*config_);
  begin_filters();
}

tiller_status_t FilterPosterior::start(const double* measured) {
  for (std::uint32_t k = 0; k < filter_.ny(); ++k)
    if (std::isinf(measured[k])) return tiller_status_sensor_not_finite;
  if (started_) {
    // the filters' history breaks: the whole window goes into the past, which costs as much as the moves of a tick
    past_.retire(window_, 0, tools());
    std::memcpy(particles_.base, particles_.sums, sizeof(double) * kRows * particles_.n());
    window_.restart();
  }
  inputs_.begin(config_->safety.safe_command);
  start_.begin_after_pause(*config_, measured);
  start_.measure_forces(filter_, chunks_[0], particles_, inputs_.rows(), disturbances_);
  begin_filters();
  if (sudden_) sudden_->begin(filter_, start_, particles_);
  if (jumps_) jumps_->stop();
  gate_.begin();
  rest_.begin();
  shoves_.begin();
  if (adequacy_) adequacy_->begin();
  started_ = true;
  return tiller_status_ok;
}

tiller_status_t FilterPosterior::skip(const Transition& transition) {
  Transition unseen = transition;
  std::fill(unseen.measured, unseen.measured + filter_.ny(), NAN);
  return advance(unseen, false);
}

tiller_status_t FilterPosterior::advance(const Transition& transition, bool moves) {
  if (!started_) return tiller_status_wrong_state;
  const tiller_status_t refusal = check_transition(*config_, transition);
  if (refusal != tiller_status_ok) return refusal;
  ++tick_;
  elapsed_s_ += transition.period_s;
  Transition now = transition;
  take_attitudes(*config_, now.measured);
  Observation seen = {now.period_s, 1.0, now.input, now.measured, inputs_.rows()};
  predict(seen);
  if (sudden_) sudden_->step(filter_, particles_, seen, noise_);
  const bool doubted = gate_.refuse(filter_, chunks_, particles_.cloud, noise_.now, now.measured);
  const bool resting = moves && rest_.resting(now);
  seen.weight = resting || sticks(seen) ? 0.0 : 1.0;
  const ShoveWatch::Verdict shove = watch(seen);
  if (adequacy_ && !resting)
    adequacy_->test_innovation(filter_, chunks_, particles_, seen, noise_.now, tempering_.exponent() < 1.0);
  if (jumps_) jumps_->step(filter_, seen, elapsed_s_, noise_.now);
  correct(seen, shove != ShoveWatch::Verdict::calm);
  if (shove == ShoveWatch::Verdict::shoved) take_back();
  // what may be a shove waits: particles that a resampling drops do not come back with what is taken back
  const tiller_status_t status = shove == ShoveWatch::Verdict::suspicious ? tempered_status() : reweight(seen);
  if (status == tiller_status_posterior_degenerate) {
    if (shove == ShoveWatch::Verdict::shoved) evidence_.take_back(-suspect_count_);
    shoves_.begin();
    return status;
  }
  const Cloud& cloud = particles_.cloud;
  if (enabled() && config_->posterior.moves_per_tick && cloud.d) {
    window_.push(seen);
    if (shove == ShoveWatch::Verdict::shoved) go_on_pushed();
    // at rest nothing is learnt: a cloud that has been swept stays as it is
    if (moves && shove == ShoveWatch::Verdict::calm && !(resting && tempering_.settled(cloud)))
      moves_.move({tools(), window_, past_, evidence_, tick_, hooks_}, particles_, tempering_);
    past_.retire(window_, config_->posterior.window, tools());
  }
  start_.note_reach(*config_, particles_);
  particles_.note_drift();
  moves_.note_swing(particles_);
  if (jumps_ && tempering_.settled(cloud) && tick_ >= FilterAdequacy::kEarly) jumps_->follow(particles_, noise_.now);
  inputs_.push(now.input);
  if (adequacy_ && !resting) {
    if (config_->posterior.relearn && adequacy_->sees_change() && config_->posterior.moves_per_tick && cloud.named)
      relearn();
    if (!(tempering_.exponent() < 1.0)) adequacy_->test_friction(particles_, evidence_, start_, elapsed_s_);
  }
  return doubted ? tiller_status_measurement_outlier : status;
}

void FilterPosterior::predict(const Observation& seen) {
  for_each_chunk(hooks_, particles_.chunks(), particles_.n() >= kWorthThreads,
                 [&](std::uint32_t c) { filter_.predict(chunks_[c], seen, particles_.step(c)); });
}

/// Whether a shove has begun or ended. A posterior that is tempered, or has only begun, takes everything for news.
ShoveWatch::Verdict FilterPosterior::watch(const Observation& seen) {
  ++learnt_ticks_;
  const bool knows = tempering_.exponent() == 1.0 && learnt_ticks_ >= kNewcomer;
  if (!sudden_ || !shoves_.may_find() || !(knows || shoves_.suspects())) return ShoveWatch::Verdict::calm;
  const bool counts = seen.weight > 0.0;
  const double ahead = counts ? sudden_->ahead_of(filter_, chunks_, particles_, noise_) : 0.0;
  const bool fresh = !shoves_.suspects();
  const ShoveWatch::Verdict verdict = shoves_.take(ahead);
  if (fresh || verdict == ShoveWatch::Verdict::calm) {
    std::fill(particles_.recent, particles_.recent + kRows * particles_.n(), 0.0);
    sure_end_ = window_.end();
    suspect_count_ = 0.0;
  }
  return verdict;
}

/// What the ticks under suspicion, this one included, said of the parameters.
void FilterPosterior::take_back() {
  for (std::uint32_t i = 0; i < kRows * particles_.n(); ++i) particles_.sums[i] -= particles_.recent[i];
  evidence_.take_back(suspect_count_);
  weigh(0, particles_.n());
}

/// All filters go on from where the one is that looks out for sudden forces, in a window that begins there: what is
/// left of the one before, the ticks under suspicion apart, goes into the past. The banks of jumps go on: a parameter's
/// jump looks like a shove at first, and they have their own filters to tell.
void FilterPosterior::go_on_pushed() {
  window_.drop_newest(sure_end_);
  past_.retire(window_, 0, tools());
  std::memcpy(particles_.base, particles_.sums, sizeof(double) * kRows * particles_.n());
  window_.restart();
  start_.begin_pushed(filter_, particles_, *sudden_);
  begin_filters();
  gate_.begin();
  if (adequacy_) adequacy_->begin();
}

/// The particles' sums, and before these what they were.
void FilterPosterior::correct(const Observation& seen, bool suspicious) {
  const std::uint32_t n = particles_.n();
  std::memcpy(particles_.scratch_row(2), particles_.sums, sizeof(double) * kRows * n);
  forget(seen);
  const double counted = evidence_.counted();
  evidence_.count(seen.measured, filter_.ny(), seen.weight);
  for (std::uint32_t i = 0; suspicious && i < kRows * n; ++i) particles_.recent[i] -= particles_.sums[i];
  for_each_chunk(hooks_, particles_.chunks(), n >= kWorthThreads, [&](std::uint32_t c) {
    CorrectJob job = filter_.correct_job(seen.measured, chunks_[c]);
    job.to = particles_.lanes(c);
    job.weight = seen.weight;
    job.squared_error = particles_.sums + ScaleEvidence::kSquared * n + c * kLanes;
    job.log_variance = particles_.sums + ScaleEvidence::kLogs * n + c * kLanes;
    filter_.correct(job);
    weigh(c * kLanes, kLanes);
  });
  if (!suspicious) return;
  for (std::uint32_t i = 0; i < kRows * n; ++i) particles_.recent[i] += particles_.sums[i];
  suspect_count_ += evidence_.counted() - counted;
}

/// What the sums of some particles say of them, into the row that reweight() reads.
void FilterPosterior::weigh(std::uint32_t first, std::uint32_t count) {
  evidence_.log_likelihood(count, particles_.sums + first, particles_.n(), particles_.scratch_row(1) + first);
}

/// Everything but the prior loses its share; the transition that is being taken in does not.
void FilterPosterior::forget(const Observation& seen) {
  const double keep = config_->posterior.forgetting_count > 0 ? config_->posterior.forgetting[0] : 1.0;
  if (keep == 1.0 || seen.weight == 0.0) return;
  evidence_.forget(keep);
  past_.forget(keep);
  suspect_count_ *= keep;
  particles_.forget(keep);
  window_.forget(keep);
}

/// Weights follow the change of the target since the last tick.
tiller_status_t FilterPosterior::reweight(const Observation& seen) {
  Cloud& cloud = particles_.cloud;
  const std::uint32_t n = cloud.n;
  double *base = particles_.scratch_row(0), *gain = particles_.scratch_row(1);
  const double* before = particles_.scratch_row(2);
  bool any_finite = false, any_dead = false;
  for (std::uint32_t i = 0; i < n; ++i) {
    const bool alive = std::isfinite(gain[i]) && std::isfinite(cloud.log_weight[i]);
    base[i] = alive ? cloud.log_weight[i] - tempering_.exponent() * particles_.log_likelihood[i] : -INFINITY;
    any_finite = any_finite || alive;
    any_dead = any_dead || !alive;
    if (alive) continue;
    gain[i] = 0.0;
    // a frozen particle that met a state that is not finite tries again from the state it had
    for (std::uint32_t r = 0; r < kRows && !enabled(); ++r) particles_.sums[r * n + i] = before[r * n + i];
  }
  if (!any_finite) {
    // no particle took the transition in: as if it had never been
    std::memcpy(particles_.sums, before, sizeof(double) * kRows * n);
    evidence_.count(seen.measured, filter_.ny(), -seen.weight);
    return tiller_status_posterior_degenerate;
  }
  if (enabled()) {
    const Tempering::Choice choice = tempering_.choose(cloud, base, gain, {});
    cloud.set_weights(base, gain, choice.exponent);
    for (std::uint32_t i = 0; i < n; ++i) particles_.log_likelihood[i] = std::isinf(base[i]) ? 0.0 : gain[i];
    // a particle whose state is not finite is replaced at once: moves and fits then find every particle alive
    if (tempering_.take(cloud, choice, any_dead)) resample();
  }
  measure_noise();
  return tempered_status();
}

void FilterPosterior::resample() {
  particles_.cloud.resample(tick_);
  particles_.permute();
  tempering_.note_resampling();
}

/// E[sigma^2] over the particles.
void FilterPosterior::measure_noise() {
  double sum = 0.0, weight = 0.0;
  for (std::uint32_t i = 0; i < particles_.n(); ++i) {
    const double squared = particles_.sums[ScaleEvidence::kSquared * particles_.n() + i];
    if (!(particles_.weight(i) > 0.0) || !std::isfinite(squared)) continue;
    sum += particles_.weight(i) * evidence_.variance(squared);
    weight += particles_.weight(i);
  }
  if (weight > 0.0) noise_.take(sum / weight);
}

/// Whether dry friction may hold a joint over the transition, as the heaviest particle has it.
bool FilterPosterior::sticks(const Observation& seen) {
  if (disturbances_.joints() == 0) return false;
  const std::uint32_t i = particles_.heaviest(), c = i / kLanes;
  return disturbances_.sticks(filter_.disturbance_job(chunks_[c], seen, particles_.step(c)), i % kLanes);
}

/// A robot that has changed: what was learnt of it becomes one half of a new prior, beside the configured one.
///
/// The change-point model of Fearnhead and Liu (JRSS B 69, 2007) with one candidate, the moment at which the adequacy
/// test sounds: before it the parameters are those of the posterior, after it they are the same with probability one
/// half, and drawn from the prior otherwise. A false alarm then costs little: the particles that were right predict
/// better than those from the prior and soon have all the weight.
void FilterPosterior::relearn() {
  ++relearned_;
  start_.begin_at_present(filter_, particles_);
  particles_.draw_again(tick_, relearned_);
  particles_.clear_sums();
  evidence_.clear();
  evidence_.believe(noise_.calm * noise_.calm, kNoiseWorth);
  noise_.now = noise_.calm;
  past_.clear();
  window_.restart();
  tempering_.restart();
  begin_filters();
  shoves_.begin();
  learnt_ticks_ = 0;
  adequacy_->restart();
}

void FilterPosterior::particle(std::uint32_t index, double* params, double* state, double* weight) const {
  const std::uint32_t n = particles_.n();
  if (index >= n) return;
  for (std::uint32_t i = 0; i < filter_.np() && params; ++i) params[i] = particles_.params_now()[i * n + index];
  for (std::uint32_t i = 0; i < filter_.nx() && state; ++i) state[i] = particles_.state(i)[index];
  if (weight) *weight = particles_.weight(index);
}

void FilterPosterior::particle_effects(std::uint32_t index, double* effect_state) const {
  for (std::uint32_t i = 0; i < filter_.ns() && index < particles_.n(); ++i)
    effect_state[i] = particles_.effect_state(i)[index];
}

void FilterPosterior::draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
                           float* history) const {
  estimate().draw(count, tick, origin(), params, state, effect_state);
  inputs_.copy(filter_.setup().delay_steps, history);
}

/// Of the noise as it was before a push put anything into it.
void FilterPosterior::contacts(double* mean, double* sd) const {
  if (!sudden_) return Posterior::contacts(mean, sd);
  sudden_->read(filter_, noise_.calm, mean, sd);
}

void FilterPosterior::report(PosteriorReport& report) const {
  report = {};
  estimate().report_noise(report);
  if (jumps_) jumps_->report(elapsed_s_, noise_.now, report);
  report.delay_weight[0] = report.forgetting_weight[0] = 1.0;
  report.relearned = relearned_;
  report.lost = past_.lost();
}

}  // namespace tiller
