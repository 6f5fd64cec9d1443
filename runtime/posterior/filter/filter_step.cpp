// One filtered transition of a chunk of lanes: what the tick, the reruns and the summary have in common.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/filter/filter_posterior.hpp"
#include "rollout/attitude.hpp"
#include "rollout/state_spread.hpp"

namespace tiller {

/// The step of a chunk's lanes from `from`, into `predicted` and the Jacobian.
void FilterPosterior::predict_lanes(const Chunk& chunk, const Step& step) const {
  const DisturbanceStates& disturbances = *chunk.lacking;
  if (disturbances.states() == 0) {
    table_->linearise(*config_->model, linearise_job(chunk, step));
    if (quaternions_ != 0) turn_jacobian(chunk, step);
    predict_covariance(chunk, step);
    return;
  }
  Turn<double> kept[kChunk], mean[kChunk];
  DisturbanceStates::Lanes16 lacking = disturbance_job(chunk, step);
  lacking.kept = kept;
  lacking.mean = mean;
  disturbances.drift(lacking);
  Step drifted = step;
  drifted.params = {chunk.drifted, kChunk};
  table_->linearise(*config_->model, linearise_job(chunk, drifted));
  disturbances.step(lacking);
  widen_jacobian(chunk, lacking);
  if (quaternions_ != 0) turn_jacobian(chunk, step);
  predict_covariance(chunk, step);
  disturbances.add_process(lacking, chunk.predicted.covariance);
}

LineariseJob FilterPosterior::linearise_job(const Chunk& chunk, const Step& step) const {
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = kChunk;
  job.period_s = step.period_s;
  job.state = {step.from.state, step.from.stride};
  job.params = step.params;
  job.effect_state = {step.from.effect_state, step.from.stride};
  job.control = {step.input, 0};
  job.history = step.history;
  job.next_state = chunk.predicted.state;
  job.next_effect_state = chunk.predicted.effect_state;
  job.a = chunk.jacobian;
  return job;
}

DisturbanceStates::Lanes16 FilterPosterior::disturbance_job(const Chunk& chunk, const Step& step) const {
  for (std::uint32_t i = 0; i < np_; ++i)
    std::memcpy(chunk.drifted + i * kChunk, step.params.data + i * step.params.stride, sizeof(double) * kChunk);
  DisturbanceStates::Lanes16 job;
  job.lanes = kChunk;
  job.period_s = step.period_s;
  job.state = {step.from.state, step.from.stride};
  job.effect_state = {step.from.effect_state, step.from.stride};
  job.params = chunk.drifted;
  job.input = step.input;
  job.history = step.history;
  job.next = chunk.predicted.state;
  job.unit = chunk.unit;
  job.push = chunk.push;
  job.law = step.law;
  return job;
}

/// Derivatives by and of a quaternion's states become those by and of its differences, along the attitude that each
/// lane had and has: then its covariance is 3 x 3, along the body's axes, with a row of zeros before it (the
/// error-state filter of Sola 2017, section 5). Beside the dynamics it costs little, so it is done lane by lane.
void FilterPosterior::turn_jacobian(const Chunk& chunk, const Step& step) const {
  for (std::uint32_t l = 0; l < kChunk; ++l) {
    for_quaternions(quaternions_, [&](std::uint32_t first) {  // forces may have pushed it off the sphere
      double* q = chunk.predicted.state + first * kChunk + l;
      write_quaternion(normalised(read_quaternion(q, kChunk)), q, kChunk);
    });
    to_tangent_columns(quaternions_, step.from.state + l, step.from.stride, chunk.nf, chunk.nf, chunk.jacobian + l,
                       kChunk);
    to_tangent_rows(quaternions_, chunk.predicted.state + l, kChunk, chunk.nf, chunk.jacobian + l, kChunk);
  }
}

/// [A G; 0 D] in the place of A, D what the disturbances keep of themselves. From the last row back: the wider rows
/// begin behind the narrower ones.
void FilterPosterior::widen_jacobian(const Chunk& chunk, const DisturbanceStates::Lanes16& lacking) const {
  double* const a = chunk.jacobian;
  const std::uint32_t nf = chunk.nf, lacks = nf - nx_;
  chunk.lacking->fill_slopes(lacking, a + std::size_t{nx_} * nf * kChunk, nf);
  for (std::uint32_t r = nx_; r-- > 0;) {
    std::memmove(a + std::size_t{r} * nf * kChunk, a + std::size_t{r} * nx_ * kChunk, sizeof(double) * nx_ * kChunk);
    std::memcpy(a + (std::size_t{r} * nf + nx_) * kChunk, chunk.push + std::size_t{r} * lacks * kChunk,
                sizeof(double) * lacks * kChunk);
  }
}

/// P' = A P A^T + Q with the chunk's Jacobian, into the chunk.
void FilterPosterior::predict_covariance(const Chunk& chunk, const Step& step) const {
  const double period_s = step.period_s;
  double process[triangle_rows(kMaxFilterStates)], state_process[TILLER_MAX_STATES * TILLER_MAX_STATES];
  std::fill(process, process + triangle_rows(chunk.nf), 0.0);
  const auto at = [&](std::uint32_t r, std::uint32_t c) -> double& { return process[triangle_row(chunk.nf, r, c)]; };
  fill_process_covariance(*config_->model, config_->process_sd, period_s, state_process);
  for (std::uint32_t r = 0; r < nx_; ++r)
    for (std::uint32_t c = r; c < nx_; ++c) at(r, c) = state_process[r * nx_ + c];
  PredictJob job;
  job.nx = chunk.nf;
  job.lanes = kChunk;
  job.dense = chunk.nf > nx_ ? nx_ : 0;
  job.a = chunk.jacobian;
  job.a_stride = kChunk;
  job.covariance = step.from.covariance;
  job.covariance_stride = step.from.stride;
  job.process = process;
  job.process_scale = has_ratio_ ? step.process_scale : nullptr;
  job.predicted = chunk.predicted.covariance;
  job.predicted_stride = kChunk;
  filter_->predict(job);
}

/// How the sensors read with each lane's parameters: rows of `stride`.
void FilterPosterior::map_sensors(const Chunk& chunk, const double* params, std::uint32_t stride) const {
  if (!chunk.gain) return;
  for (std::uint32_t k = 0; k < ny_; ++k)
    for (std::uint32_t l = 0; l < kChunk; ++l) {
      const MeasurementMap map = measurement_map(*config_, config_->measured_state[k], params + l, stride);
      chunk.gain[k * kChunk + l] = map.gain;
      chunk.offset[k * kChunk + l] = map.offset;
    }
}

/// From `predicted` into `filter`; the caller sets the sums.
CorrectJob FilterPosterior::correct_job(const double* measured, const Chunk& chunk) const {
  CorrectJob job;
  job.nx = chunk.nf;
  job.ns = ns_;
  job.ny = ny_;
  job.lanes = kChunk;
  job.gain = chunk.gain;
  job.offset = chunk.offset;
  job.angle_mask = config_->model->angle_mask;
  job.quaternion_mask = quaternions_;
  job.measured_state = config_->measured_state;
  job.measured = measured;
  job.variance = measurement_variance_;
  job.from = chunk.predicted;
  job.to = chunk.filter;
  job.normalised = chunk.normalised;
  return job;
}

}  // namespace tiller
