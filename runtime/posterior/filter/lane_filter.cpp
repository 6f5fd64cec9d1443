#include "posterior/filter/lane_filter.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/attitude_measurement.hpp"
#include "rollout/attitude.hpp"
#include "rollout/state_spread.hpp"

namespace tiller {

FilterRows lay_out_filters(Arena& arena, std::uint32_t states, std::uint32_t effect_states, std::uint32_t stride) {
  FilterRows rows;
  rows.state = arena.take<double>(std::size_t{states} * stride);
  rows.covariance = arena.take<double>(std::size_t{triangle_rows(states)} * stride);
  rows.effect_state = arena.take<double>(std::size_t{effect_states} * stride);
  rows.stride = stride;
  return rows;
}

void filter_difference(const FilterRows& rows, std::uint32_t quaternions, std::uint32_t nf, std::uint32_t i,
                       std::uint32_t about, double* off) {
  const std::uint32_t stride = rows.stride;
  for (std::uint32_t r = 0; r < nf; ++r) off[r] = rows.state[r * stride + i] - rows.state[r * stride + about];
  for_quaternions(quaternions, [&](std::uint32_t first) {
    const double* q = rows.state + first * stride;
    const Vector3<double> d = attitude_difference(read_quaternion(q + i, stride), read_quaternion(q + about, stride));
    write_quaternion({0.0, d.x, d.y, d.z}, off + first);
  });
}

FilterChunk* FilterChunk::lay_out(Arena& arena, std::uint32_t count, const tiller_config_t& config,
                                  const StepSetup& setup, const DisturbanceStates& disturbances,
                                  const DisturbanceStates* at, std::uint32_t d) {
  const std::uint32_t nx = config.model->state_count, np = config.param_count, ny = config.measurement_count;
  const auto rows = [&arena](std::uint32_t height) { return arena.take<double>(std::size_t{height} * kLanes); };
  auto* const chunks = arena.take<FilterChunk>(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    FilterChunk c;
    c.lacking = at;
    c.nf = nx + disturbances.states();
    c.params = rows(np);
    if (disturbances.states() > 0) c.drifted = rows(np + 1);
    c.coordinate = rows(d);
    c.filter = lay_out_filters(arena, c.nf, setup.effect_state_count, kLanes);
    c.predicted = lay_out_filters(arena, c.nf, setup.effect_state_count, kLanes);
    c.process_scale = rows(1);
    if (disturbances.states() > 0) c.law = rows(disturbances.law_rows());
    c.jacobian = rows(c.nf * c.nf);
    c.sums = rows(ScaleEvidence::kRows);
    c.normalised = rows(ny);
    c.unit = rows(nx * disturbances.sources());
    c.push = rows(nx * disturbances.states());
    if (has_sensor_effects(config)) {
      c.gain = rows(ny);
      c.offset = rows(ny);
    }
    if (has_late_readings(config)) c.rate_gain = rows(ny);
    if (chunks) chunks[i] = c;
  }
  return chunks;
}

void FilterChunk::clear_sums() const { std::memset(sums, 0, sizeof(double) * ScaleEvidence::kRows * kLanes); }

LaneFilter::LaneFilter(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                       bool scales_process)
    : config_(&config), setup_(setup), table_(&table), lanes_(&filter_table()), scales_process_(scales_process) {
  for (std::uint32_t k = 0; k < ny(); ++k)
    measurement_variance_[k] = config.measurement_sd[k] * config.measurement_sd[k];
  for (std::uint32_t k = 0; k < ny(); ++k) rate_state_[k] = velocity_of(*config.model, config.measured_state[k]);
}

void LaneFilter::predict(const FilterChunk& chunk, const Observation& seen, const LaneStep& step) const {
  const DisturbanceStates& disturbances = *chunk.lacking;
  const Lanes<double> before = {step.from.state, step.from.stride};
  if (disturbances.states() == 0) {
    linearise(linearise_job(chunk, seen, step));
    if (quaternions() != 0) turn_jacobian(chunk, step);
    predict_covariance(chunk, seen.period_s, step);
    map_sensors(chunk, step.params, {chunk.predicted.state, kLanes}, before, seen.period_s);
    return;
  }
  Turn<double> kept[kLanes], mean[kLanes];
  DisturbanceStates::Lanes16 lacking = disturbance_job(chunk, seen, step);
  lacking.kept = kept;
  lacking.mean = mean;
  disturbances.drift(lacking);
  LaneStep drifted = step;
  drifted.params = {chunk.drifted, kLanes};
  linearise(linearise_job(chunk, seen, drifted));
  disturbances.step(lacking);
  widen_jacobian(chunk, lacking);
  if (quaternions() != 0) turn_jacobian(chunk, step);
  predict_covariance(chunk, seen.period_s, step);
  disturbances.add_process(lacking, chunk.predicted.covariance);
  map_sensors(chunk, step.params, {chunk.predicted.state, kLanes}, before, seen.period_s);
}

LineariseJob LaneFilter::linearise_job(const FilterChunk& chunk, const Observation& seen, const LaneStep& step) const {
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = kLanes;
  job.period_s = seen.period_s;
  job.state = {step.from.state, step.from.stride};
  job.params = step.params;
  job.effect_state = {step.from.effect_state, step.from.stride};
  job.control = {seen.input, 0};
  job.history = seen.history;
  job.next_state = chunk.predicted.state;
  job.next_effect_state = chunk.predicted.effect_state;
  job.a = chunk.jacobian;
  return job;
}

DisturbanceStates::Lanes16 LaneFilter::disturbance_job(const FilterChunk& chunk, const Observation& seen,
                                                       const LaneStep& step) const {
  for (std::uint32_t i = 0; i < np(); ++i)
    std::memcpy(chunk.drifted + i * kLanes, step.params.data + i * step.params.stride, sizeof(double) * kLanes);
  DisturbanceStates::Lanes16 job;
  job.lanes = kLanes;
  job.period_s = seen.period_s;
  job.state = {step.from.state, step.from.stride};
  job.effect_state = {step.from.effect_state, step.from.stride};
  job.params = chunk.drifted;
  job.input = seen.input;
  job.history = seen.history;
  job.next = chunk.predicted.state;
  job.unit = chunk.unit;
  job.push = chunk.push;
  job.law = step.law;
  return job;
}

/// Derivatives by and of a quaternion's states become those by and of its differences, along the attitude that each
/// lane had and has: then its covariance is 3 x 3, along the body's axes, with a row of zeros before it (the
/// error-state filter of Sola 2017, section 5). Beside the dynamics it costs little, so it is done lane by lane.
void LaneFilter::turn_jacobian(const FilterChunk& chunk, const LaneStep& step) const {
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    for_quaternions(quaternions(), [&](std::uint32_t first) {  // forces may have pushed it off the sphere
      double* q = chunk.predicted.state + first * kLanes + l;
      write_quaternion(normalised(read_quaternion(q, kLanes)), q, kLanes);
    });
    to_tangent_columns(quaternions(), step.from.state + l, step.from.stride, chunk.nf, chunk.nf, chunk.jacobian + l,
                       kLanes);
    to_tangent_rows(quaternions(), chunk.predicted.state + l, kLanes, chunk.nf, chunk.jacobian + l, kLanes);
  }
}

/// [A G; 0 D] in the place of A, D what the disturbances keep of themselves. From the last row back: the wider rows
/// begin behind the narrower ones.
void LaneFilter::widen_jacobian(const FilterChunk& chunk, const DisturbanceStates::Lanes16& lacking) const {
  double* const a = chunk.jacobian;
  const std::uint32_t nx = this->nx(), nf = chunk.nf, lacks = nf - nx;
  chunk.lacking->fill_slopes(lacking, a + std::size_t{nx} * nf * kLanes, nf);
  for (std::uint32_t r = nx; r-- > 0;) {
    std::memmove(a + std::size_t{r} * nf * kLanes, a + std::size_t{r} * nx * kLanes, sizeof(double) * nx * kLanes);
    std::memcpy(a + (std::size_t{r} * nf + nx) * kLanes, chunk.push + std::size_t{r} * lacks * kLanes,
                sizeof(double) * lacks * kLanes);
  }
}

/// P' = A P A^T + Q with the chunk's Jacobian, into the chunk.
void LaneFilter::predict_covariance(const FilterChunk& chunk, double period_s, const LaneStep& step) const {
  const std::uint32_t nx = this->nx();
  double process[triangle_rows(kMaxFilterStates)], state_process[TILLER_MAX_STATES * TILLER_MAX_STATES];
  std::fill(process, process + triangle_rows(chunk.nf), 0.0);
  const auto at = [&](std::uint32_t r, std::uint32_t c) -> double& { return process[triangle_row(chunk.nf, r, c)]; };
  fill_process_covariance(*config_->model, config_->process_sd, period_s, state_process);
  for (std::uint32_t r = 0; r < nx; ++r)
    for (std::uint32_t c = r; c < nx; ++c) at(r, c) = state_process[r * nx + c];
  PredictJob job;
  job.nx = chunk.nf;
  job.lanes = kLanes;
  job.dense = chunk.nf > nx ? nx : 0;
  job.a = chunk.jacobian;
  job.a_stride = kLanes;
  job.covariance = step.from.covariance;
  job.covariance_stride = step.from.stride;
  job.process = process;
  job.process_scale = scales_process_ ? step.process_scale : nullptr;
  job.predicted = chunk.predicted.covariance;
  job.predicted_stride = kLanes;
  lanes_->predict(job);
}

void LaneFilter::map_sensors(const FilterChunk& chunk, Lanes<double> params, Lanes<double> state, Lanes<double> before,
                             double period_s) const {
  if (!chunk.gain) return;
  for (std::uint32_t k = 0; k < ny(); ++k)
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      const std::uint32_t i = config_->measured_state[k];
      const SensorSight<double> at =
          sight_of(*config_->model, i, state.data + (state.splat() ? 0 : l), state.splat() ? 1 : state.stride,
                   before.data ? before.data + l : nullptr, before.stride, period_s);
      const MeasurementMap map = measurement_map(*config_, i, at, params.data + l, params.stride);
      chunk.gain[k * kLanes + l] = map.gain;
      chunk.offset[k * kLanes + l] = map.offset;
      if (chunk.rate_gain) chunk.rate_gain[k * kLanes + l] = map.rate_gain;
    }
}

LaneFilter::Residual LaneFilter::residual(const FilterChunk& chunk, std::uint32_t lane, const double* measured,
                                          std::uint32_t k) const {
  const std::uint32_t state = config_->measured_state[k];
  const MeasurementMap map = sensor(chunk, k, lane);
  const auto covariance = [&](std::uint32_t i, std::uint32_t j) {
    return chunk.predicted.covariance[triangle_row(chunk.nf, i, j) * kLanes + lane];
  };
  return {innovation_of(*config_, measured, k, chunk.predicted.state + lane, kLanes, map),
          reading_variance(*config_->model, map, state, covariance) + measurement_variance_[k]};
}

CorrectJob LaneFilter::correct_job(const double* measured, const FilterChunk& chunk) const {
  CorrectJob job;
  job.nx = chunk.nf;
  job.ns = ns();
  job.ny = ny();
  job.lanes = kLanes;
  job.gain = chunk.gain;
  job.offset = chunk.offset;
  job.rate_gain = chunk.rate_gain;
  job.rate_state = rate_state_;
  job.angle_mask = config_->model->angle_mask;
  job.quaternion_mask = quaternions();
  job.measured_state = config_->measured_state;
  job.measured = measured;
  job.variance = measurement_variance_;
  job.from = chunk.predicted;
  job.to = chunk.filter;
  job.normalised = chunk.normalised;
  return job;
}

void LaneFilter::predict_own(const FilterChunk& chunk, const Observation& seen, const FilterRows& at) const {
  predict(chunk, seen, {at, {chunk.params, kLanes}, chunk.process_scale, {chunk.law, kLanes}});
}

void LaneFilter::correct_own(const FilterChunk& chunk, const Observation& seen, const FilterRows& at) const {
  CorrectJob job = correct_job(seen.measured, chunk);
  job.to = at;
  job.weight = seen.weight;
  job.squared_error = chunk.sums + ScaleEvidence::kSquared * kLanes;
  job.log_variance = chunk.sums + ScaleEvidence::kLogs * kLanes;
  lanes_->correct(job);
}

}  // namespace tiller
