// The part of the tick that filters: predict, gate, correct.

#include "posterior/filter/filter_posterior.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/attitude_measurement.hpp"
#include "posterior/tasks.hpp"

namespace tiller {

namespace {

/// Deviations beyond which a measurement counts as an outlier if no particle can explain it. A normal innovation
/// never gets there; what does is a glitch of the sensor.
constexpr double kGate = 8.0;
/// Outliers in a row after which a measurement is believed after all: then the world has changed, not the sensor.
constexpr std::uint32_t kGateRun = 5;

}  // namespace

void FilterPosterior::reset() {
  cloud_.prior.believe_before(nullptr);
  cloud_.draw_prior();
  const std::size_t all = std::size_t{rows_} * n_;
  std::memset(carried_.sums, 0, sizeof(double) * all);
  std::memset(carried_.base, 0, sizeof(double) * all);
  std::memset(carried_.log_likelihood, 0, sizeof(double) * n_);
  for (std::uint32_t k = 0; k < n_; ++k)
    read_own(cloud_.coordinate + k, n_, carried_.process_scale + k, lacks_ > 0 ? carried_.law + k : nullptr, n_);
  evidence_.believe_configuration();
  evidence_.clear();
  window_.clear();
  window_begin_ = 0;
  window_exact_ = true;
  summary_.clear();
  disturbances_.clear();
  shape_.clear();
  if (guided() && disturbances_.swings())
    swing_.begin(cloud_.prior, d_ - disturbances_.drifts() - 2, disturbances_.sizes(), config_->period_s);
  elapsed_s_ = began_s_ = 0.0;
  started_ = banks_begun_ = false;
  tick_ = 0;
  exponent_ = 1.0;
  noise_scale_ = calm_scale_ = 1.0;
  acceptance_ = 0.0;
  cursor_ = moved_ = leaves_ = trial_ = 0;
  early_ = kEarly;
  for (std::uint32_t& run : gate_run_) run = 0;
  clear_adequacy();
  for (double& reach : reach_) reach = 0.0;
  set_start(config_->initial_state_sd, nullptr);
  begin_all_filters();
}

void FilterPosterior::read_own(const double* coordinate, std::uint32_t stride, double* process_scale, double* law,
                               std::uint32_t law_stride) const {
  const double* own = coordinate + std::size_t{cloud_.named} * stride;
  *process_scale = has_ratio_ ? math::exp(2.0 * own[0]) : 1.0;
  if (lacks_ == 0) return;
  if (enabled_)
    disturbances_.read_law(has_ratio_ ? own + stride : own, stride, law, law_stride);
  else
    disturbances_.fixed_law(law, law_stride);
}

tiller_status_t FilterPosterior::skip(const Transition& transition) {
  Transition unseen = transition;
  for (std::uint32_t k = 0; k < ny_; ++k) unseen.measured[k] = NAN;
  return advance(unseen, false);
}

tiller_status_t FilterPosterior::update(const Transition& transition) { return advance(transition, true); }

tiller_status_t FilterPosterior::advance(const Transition& transition, bool moves) {
  if (!started_) return tiller_status_wrong_state;
  const tiller_status_t refusal = check_transition(*config_, transition);
  if (refusal != tiller_status_ok) return refusal;
  ++tick_;
  elapsed_s_ += transition.period_s;
  now_.transition = transition;
  take_attitudes(*config_, now_.transition.measured);
  predict();
  step_touch(now_.transition.measured);
  const bool doubted = gate(now_.transition);
  const bool resting = moves && rest_.resting(now_.transition);
  now_.weight = resting || sticks() ? 0.0 : 1.0;
  if (adequacy_ && !resting) test_innovation();
  step_banks();
  std::memcpy(scratch_row(2), carried_.sums, sizeof(double) * rows_ * n_);
  correct();
  const tiller_status_t status = reweight();
  if (status == tiller_status_posterior_degenerate) return status;
  if (enabled_ && config_->posterior.moves_per_tick && d_) {
    remember_transition();
    // at rest nothing is learnt: a cloud that has been swept stays as it is
    if (moves && !(resting && moved_ >= n_ && exponent_ == 1.0)) move();
    retire(config_->posterior.window);
  }
  note_reach();
  note_drift();
  note_swing();
  watch_jumps();
  remember_input(now_.transition.input);
  watch_change(resting);
  if (adequacy_ && !resting) test_friction();
  return doubted ? tiller_status_measurement_outlier : status;
}

void FilterPosterior::predict() {
  for_each_chunk(hooks_, n_ / kChunk, n_ >= kWorthThreads, [this](std::uint32_t c) { predict_chunk(c); });
}

void FilterPosterior::predict_chunk(std::uint32_t c) const {
  map_sensors(chunks_[c], cloud_.params + c * kChunk, n_);
  predict_lanes(chunks_[c], particle_step(c));
}

/// The filters of particles at .. at + kChunk - 1.
FilterRows FilterPosterior::carried_lanes(std::uint32_t at) const {
  return {carried_.filter.state + at, carried_.filter.covariance + at, carried_.filter.effect_state + at, n_};
}

/// A chunk's own particles at the transition that is being taken in.
FilterPosterior::Step FilterPosterior::particle_step(std::uint32_t c) const {
  const std::uint32_t at = c * kChunk;
  Step step;
  step.period_s = now_.transition.period_s;
  step.input = now_.transition.input;
  step.from = carried_lanes(at);
  step.params = {cloud_.params + at, n_};
  step.process_scale = carried_.process_scale + at;
  if (lacks_ > 0) step.law = {carried_.law + at, n_};
  step.history = input_history_;
  return step;
}

/// A value that is beyond kGate deviations for every particle is a glitch: it is treated as missing, here and in
/// every later rerun. One particle that can explain it makes it data. True if nothing is left of a measurement.
bool FilterPosterior::gate(Transition& t) {
  bool any = false, left = false;
  for (std::uint32_t k = 0; k < ny_; ++k) {
    if (std::isnan(t.measured[k])) continue;
    any = true;
    if (gate_run_[k] >= kGateRun || explained(t, k)) {
      gate_run_[k] = 0;
      left = true;
      continue;
    }
    t.measured[k] = NAN;
    ++gate_run_[k];
    ++gated_;
  }
  drop_parts(*config_, t.measured);
  return any && !left;
}

bool FilterPosterior::explained(const Transition& t, std::uint32_t k) const {
  // the first particle usually ends the search
  for (std::uint32_t i = 0; i < n_; ++i)
    if (cloud_.weight[i] > 0.0 && lane_explains(chunks_[i / kChunk], i % kChunk, t.measured, k)) return true;
  return false;
}

bool FilterPosterior::lane_explains(const Chunk& chunk, std::uint32_t lane, const double* measured,
                                    std::uint32_t k) const {
  const std::uint32_t state = config_->measured_state[k], row = triangle_row(nf_, state, state);
  const double scale = std::fmax(1.0, noise_scale_ * noise_scale_);
  const MeasurementMap map = sensor(chunk, k, lane);
  const double error = innovation_of(*config_, measured, k, chunk.predicted.state + lane, kChunk, map);
  const double variance =
      map.gain * map.gain * chunk.predicted.covariance[row * kChunk + lane] + measurement_variance_[k];
  return error * error <= kGate * kGate * scale * variance;
}

void FilterPosterior::correct() {
  forget();
  for_each_chunk(hooks_, n_ / kChunk, n_ >= kWorthThreads, [this](std::uint32_t c) { correct_chunk(c); });
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (!std::isnan(now_.transition.measured[k])) evidence_.count(now_.weight);
}

void FilterPosterior::correct_chunk(std::uint32_t c) const {
  const std::uint32_t at = c * kChunk;
  CorrectJob job = correct_job(now_.transition.measured, chunks_[c]);
  job.to = carried_lanes(at);
  job.weight = now_.weight;
  job.squared_error = carried_.sums + ScaleEvidence::kSquared * n_ + at;
  job.log_variance = carried_.sums + ScaleEvidence::kLogs * n_ + at;
  filter_->correct(job);
}

/// Everything but the prior loses its share; the transition that is being taken in does not.
void FilterPosterior::forget() {
  if (keep_ == 1.0 || now_.weight == 0.0) return;
  evidence_.forget(keep_);
  summary_.forget(keep_);
  for (std::size_t i = 0; i < std::size_t{rows_} * n_; ++i) {
    carried_.sums[i] *= keep_;
    carried_.base[i] *= keep_;
  }
  for (std::uint64_t k = window_begin_; k < window_.end(); ++k) window_[k].weight *= keep_;
}

/// The heaviest particle's filter stands for all.
std::uint32_t FilterPosterior::heaviest() const {
  std::uint32_t heaviest = 0;
  for (std::uint32_t i = 1; i < n_; ++i)
    if (cloud_.weight[i] > cloud_.weight[heaviest]) heaviest = i;
  return heaviest;
}

/// Whether dry friction may hold a joint over the transition that is being taken in, as the heaviest particle has it.
bool FilterPosterior::sticks() {
  if (disturbances_.joints() == 0) return false;
  const std::uint32_t i = heaviest();
  return disturbances_.sticks(disturbance_job(chunks_[i / kChunk], particle_step(i / kChunk)), i % kChunk);
}

void FilterPosterior::remember_transition() {
  const auto slot = static_cast<std::size_t>(window_.end() % window_.capacity());
  const std::size_t row = std::size_t{setup_.delay_steps} * nu_;
  std::memcpy(window_history_ + slot * row, input_history_, sizeof(double) * row);
  Kept& kept = window_.push();
  kept.period_s = now_.transition.period_s;
  kept.weight = now_.weight;
  std::copy(now_.transition.input, now_.transition.input + nu_, kept.input);
  std::copy(now_.transition.measured, now_.transition.measured + ny_, kept.measured);
}

const double* FilterPosterior::history_of(std::uint64_t index) const {
  return window_history_ + (index % window_.capacity()) * setup_.delay_steps * nu_;
}

void FilterPosterior::remember_input(const double* input) {
  std::memmove(input_history_ + nu_, input_history_, sizeof(double) * (kHistory - 1) * nu_);
  std::memcpy(input_history_, input, sizeof(double) * nu_);
}

}  // namespace tiller
