#include "posterior/filter/filter_start.hpp"

#include <algorithm>
#include <cmath>

#include "posterior/attitude_measurement.hpp"
#include "posterior/filter/sudden_forces.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

namespace {

constexpr std::uint32_t kLanes = FilterChunk::kLanes;

}  // namespace

FilterStart FilterStart::lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t states,
                                 std::uint32_t effect_states) {
  FilterStart s;
  s.nx_ = config.model->state_count;
  s.nf_ = states;
  s.ns_ = effect_states;
  s.ny_ = config.measurement_count;
  const FilterRows law = lay_out_filters(arena, states, effect_states, 1);
  s.state_ = law.state;
  s.covariance_ = law.covariance;
  s.effect_state_ = law.effect_state;
  s.measured_ = arena.take<double>(s.ny_);
  return s;
}

void FilterStart::clear() {
  std::fill(state_, state_ + nf_, 0.0);
  std::fill(covariance_, covariance_ + triangle_rows(nf_), 0.0);
  std::fill(effect_state_, effect_state_ + ns_, 0.0);
  std::fill(measured_, measured_ + ny_, NAN);
}

void FilterStart::reset(const tiller_config_t& config) {
  std::fill(reach_, reach_ + nx_, 0.0);
  set(config, config.initial_state_sd);
}

void FilterStart::begin_after_pause(const tiller_config_t& config, const double* measured) {
  double sd[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < nx_; ++i) sd[i] = std::hypot(config.initial_state_sd[i], reach_[i]);
  set(config, sd);
  std::copy(measured, measured + ny_, measured_);
  take_attitudes(config, measured_);
}

/// The configured state with deviations sd (nx).
void FilterStart::set(const tiller_config_t& config, const double* sd) {
  const std::uint32_t quaternions = config.model->quaternion_mask;
  clear();
  for (std::uint32_t r = 0; r < nx_; ++r) {
    state_[r] = config.initial_state[r];
    covariance_[triangle_row(nf_, r, r)] = (quaternions >> r) & 1u ? 0.0 : sd[r] * sd[r];
  }
  for_quaternions(quaternions, [&](std::uint32_t first) {
    write_quaternion(normalised(read_quaternion(state_ + first)), state_ + first);
  });
  has_forces_ = false;
}

void FilterStart::begin_filters(const LaneFilter& filter, const FilterChunk& chunk, const FilterRows& rows,
                                Lanes<double> params, Lanes<double> law) const {
  double unused[2 * kLanes] = {};
  const auto fill = [&rows](double* to, std::uint32_t count, const double* value) {
    for (std::uint32_t i = 0; i < count; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l) to[i * rows.stride + l] = value[i];
  };
  fill(rows.state, nf_, state_);
  fill(rows.covariance, triangle_rows(nf_), covariance_);
  fill(rows.effect_state, ns_, effect_state_);
  for (std::uint32_t l = 0; l < kLanes && nf_ > nx_ && !has_forces_; ++l) {
    double variance[kMaxFilterStates];
    chunk.lacking->prior_variance(law.data + l, law.stride, variance);
    for (std::uint32_t f = nx_; f < nf_; ++f)
      rows.covariance[triangle_row(nf_, f, f) * rows.stride + l] = variance[f - nx_];
  }
  filter.map_sensors(chunk, params, {state_, 0}, {}, 0.0);
  CorrectJob job = filter.correct_job(measured_, chunk);
  job.from = job.to = rows;
  job.squared_error = unused;
  job.log_variance = unused + kLanes;
  filter.correct(job);
}

void FilterStart::begin_all(const LaneFilter& filter, const FilterChunk* chunks, FilterParticles& particles) const {
  for (std::uint32_t c = 0; c < particles.chunks(); ++c) {
    begin_filters(filter, chunks[c], particles.lanes(c), {particles.params_of(c), particles.n()}, particles.laws_of(c));
  }
  particles.note_drift();
}

void FilterStart::measure_forces(const LaneFilter& filter, const FilterChunk& chunk, const FilterParticles& particles,
                                 const double* history, DisturbanceStates& disturbances) const {
  if (disturbances.states() == 0) return;
  begin_filters(filter, chunk, chunk.filter, {particles.cloud.params, particles.n()}, particles.laws_of(0));
  Observation idle;
  idle.period_s = filter.config().period_s;
  idle.input = filter.config().safety.safe_command;
  idle.history = history;
  const LaneStep step = {chunk.filter, {particles.cloud.params, particles.n()}, nullptr, particles.laws_of(0)};
  filter.predict(chunk, idle, step);
  disturbances.measure_reach(filter.disturbance_job(chunk, idle, step));
}

void FilterStart::begin_at_present(const LaneFilter& filter, const FilterParticles& particles) {
  const DisturbanceStates& disturbances = *particles.disturbances;
  clear();
  // filters that begin with one law of the friction, whatever size a particle has, are judged by the mean size
  for (std::uint32_t j = 0; j < disturbances.joints() && disturbances.has_friction(); ++j)
    friction_law_[j] = particles.mean(particles.law(j));
  has_forces_ = true;
  take_mixture(filter, {particles.filter, particles.n(), particles.heaviest(), particles.cloud.weight});
}

void FilterStart::begin_pushed(const LaneFilter& filter, const FilterParticles& particles, const SuddenForces& sudden) {
  begin_at_present(filter, particles);
  const std::uint32_t triangle = triangle_rows(nf_);
  double state[kMaxFilterStates], covariance[triangle_rows(kMaxFilterStates)];
  std::copy(state_, state_ + nf_, state);
  std::copy(covariance_, covariance_ + triangle, covariance);
  double weight[kLanes];
  std::fill(weight, weight + kLanes, 1.0 / kLanes);
  std::fill(state_, state_ + nf_, 0.0);
  std::fill(covariance_, covariance_ + triangle, 0.0);
  std::fill(effect_state_, effect_state_ + ns_, 0.0);
  take_mixture(filter, {sudden.lanes().filter, kLanes, 0, weight});
  const auto known = [&](std::uint32_t r) { return r >= nx_ && !sudden.is_sudden(r - nx_); };
  for (std::uint32_t r = 0; r < nf_; ++r) {
    if (known(r)) state_[r] = state[r];
    for (std::uint32_t c = r; c < nf_; ++c) {
      const std::uint32_t at = triangle_row(nf_, r, c);
      if (known(r) || known(c)) covariance_[at] = known(r) && known(c) ? covariance[at] : 0.0;
    }
  }
}

/// += mean and covariance of a mixture of filters.
void FilterStart::take_mixture(const LaneFilter& filter, const Mixture& mixture) {
  const FilterRows& rows = mixture.rows;
  const std::uint32_t about = mixture.about, quaternions = filter.quaternions();
  double off[kMaxFilterStates];
  for (std::uint32_t i = 0; i < mixture.count; ++i) {
    const double w = mixture.weight[i];
    if (!(w > 0.0)) continue;
    filter_difference(rows, quaternions, nf_, i, about, off);
    for (std::uint32_t r = 0; r < nf_; ++r) state_[r] += w * off[r];
    for (std::uint32_t s = 0; s < ns_; ++s) effect_state_[s] += w * rows.effect_state[s * rows.stride + i];
  }
  for (std::uint32_t i = 0; i < mixture.count; ++i) {
    const double w = mixture.weight[i];
    if (!(w > 0.0)) continue;
    filter_difference(rows, quaternions, nf_, i, about, off);
    for (std::uint32_t r = 0; r < nf_; ++r) off[r] -= state_[r];
    for (std::uint32_t r = 0; r < nf_; ++r)
      for (std::uint32_t c = r; c < nf_; ++c) {
        const std::uint32_t at = triangle_row(nf_, r, c);
        covariance_[at] += w * (rows.covariance[at * rows.stride + i] + off[r] * off[c]);
      }
  }
  for_quaternions(quaternions, [&](std::uint32_t first) {
    const Quaternion<double> middle = read_quaternion(rows.state + first * rows.stride + about, rows.stride);
    const double* d = state_ + first;
    const Quaternion<double> q = normalised(attitude_sum(middle, {d[1], d[2], d[3]}));
    // what is added below
    write_quaternion({q.w - middle.w, q.x - middle.x, q.y - middle.y, q.z - middle.z}, state_ + first);
  });
  for (std::uint32_t r = 0; r < nf_; ++r) state_[r] += rows.state[r * rows.stride + about];
}

void FilterStart::note_reach(const tiller_config_t& config, const FilterParticles& particles) {
  const std::uint32_t particle = particles.heaviest();
  double at[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < nx_; ++i) at[i] = particles.state(i)[particle];
  state_differences(*config.model, at, config.initial_state, at);
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double off = std::fabs(at[i]);
    if (off > reach_[i] && std::isfinite(off)) reach_[i] = off;
  }
}

}  // namespace tiller
