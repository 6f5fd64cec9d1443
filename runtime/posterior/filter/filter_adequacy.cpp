#include "posterior/filter/filter_adequacy.hpp"

#include <cmath>

#include "rollout/attitude.hpp"

namespace tiller {

namespace {

constexpr std::uint32_t kLanes = FilterChunk::kLanes;
/// Who has explained the data for so many ticks after an alarm has been right.
constexpr std::uint32_t kTrial = 1024;
/// An alarm within so many ticks of learning again is no change of the robot: no parameters explain it, or it came in
/// the middle of something else. If it lasts, the posterior tries again, after twice as long every time, up
/// to a trial: what was learnt in a bad moment is not for ever believed.
constexpr std::uint32_t kShortestWait = 256, kLongestWait = kTrial;

}  // namespace

FilterAdequacy* FilterAdequacy::lay_out(Arena& arena, const tiller_config_t& config,
                                        const DisturbanceStates& disturbances) {
  // a cloud that does not learn has innovations that go with whatever its parameters are off by
  if (!config.posterior.adequacy || !config.posterior.enabled) return nullptr;
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count;
  auto* const a = arena.take<FilterAdequacy>(1);
  auto* const test =
      AdequacyTest::lay_out(arena, config, false, disturbances.has_friction() ? 2 * disturbances.joints() : 0);
  auto* const response = DisturbanceResponse::lay_out(arena, config, nx + disturbances.states());
  auto* const scratch = arena.take<double>(std::size_t{nx + nx * nx + nx * nu} * kLanes);
  if (!a) return nullptr;
  a->test_ = test;
  a->response_ = response;
  a->scratch_ = scratch;
  return a;
}

void FilterAdequacy::clear() {
  test_->reset();
  response_->begin();
}

void FilterAdequacy::reset() {
  clear();
  trial_ = wait_ = 0;
  next_wait_ = kShortestWait;
  early_ = kEarly;
}

void FilterAdequacy::begin() {
  test_->begin();
  response_->begin();
}

void FilterAdequacy::restart() {
  early_ = kEarly;
  test_->restart();
  response_->begin();
}

bool FilterAdequacy::sees_change() {
  if (wait_ > 0) --wait_;
  if (test_->sounds()) {
    trial_ = kTrial;
    if (wait_ > 0) return false;
    wait_ = next_wait_;
    if (next_wait_ < kLongestWait) next_wait_ *= 2;
    return true;
  }
  if (trial_ == 0 || --trial_ > 0) return false;
  next_wait_ = kShortestWait;
  if (test_->state() == tiller_adequacy_inadequate) test_->withdraw();
  return false;
}

/// Predictive variance: what each filter expects, times the noise's estimated scale, and what the particles disagree
/// about. Cost: O(N ny).
void FilterAdequacy::test_innovation(const LaneFilter& filter, const FilterChunk* chunks,
                                     const FilterParticles& particles, const Observation& seen, double noise_scale,
                                     bool tempered) {
  const tiller_config_t& config = filter.config();
  const std::uint32_t nx = filter.nx();
  Innovation now;
  double speed[TILLER_MAX_MEASUREMENTS], place[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < filter.ny(); ++k) {
    const std::uint32_t state = config.measured_state[k];
    double mean = 0.0, square = 0.0, within = 0.0, moved = 0.0;
    for (std::uint32_t i = 0; i < particles.n(); ++i) {
      const FilterChunk& chunk = chunks[i / kLanes];
      const std::uint32_t lane = i % kLanes;
      const double w = particles.weight(i), predicted = chunk.predicted.state[state * kLanes + lane];
      if (!(w > 0.0) || !std::isfinite(predicted)) continue;
      const LaneFilter::Residual r = filter.residual(chunk, lane, seen.measured, k);
      mean += w * r.error;
      square += w * r.error * r.error;
      within += w * r.variance;
      moved += w * (predicted - particles.state(state)[i]);  // of a quaternion a feature as good as any
    }
    const double between = std::fmax(0.0, square - mean * mean);
    now.normalised[k] = mean / std::sqrt(noise_scale * noise_scale * within + between);
    const std::uint32_t velocity = velocity_state(*config.model, state);
    speed[k] = velocity < nx ? particles.mean(particles.state(velocity)) : moved / seen.period_s;
    const std::uint32_t position = position_state(*config.model, state);
    place[k] = position < nx ? particles.mean(particles.state(position)) : 0.0;
  }
  respond(filter, chunks, particles, seen, speed, particles.disturbances->joints() > 0 ? place : nullptr, now);
  const bool early = early_ > 0;
  if (early) --early_;
  if (early && tempered) test_->begin();
  test_->take(now);
}

/// The heaviest particle's filter stands for all: a feature need only be known beforehand, and they hardly differ. Its
/// Jacobian is the prediction's; that by the inputs is made here.
void FilterAdequacy::respond(const LaneFilter& filter, const FilterChunk* chunks, const FilterParticles& particles,
                             const Observation& seen, const double* speed, const double* place, Innovation& now) {
  const std::uint32_t i = particles.heaviest(), lane = i % kLanes, nx = filter.nx(), nu = filter.nu();
  const FilterChunk& chunk = chunks[i / kLanes];
  LineariseJob job = filter.linearise_job(chunk, seen, particles.step(i / kLanes));
  if (chunk.drifted) job.params = {chunk.drifted, kLanes};
  job.next_state = scratch_;
  job.next_effect_state = nullptr;
  job.a = scratch_ + std::size_t{nx} * kLanes;
  job.b = job.a + std::size_t{nx} * nx * kLanes;
  filter.linearise(job);
  to_tangent_rows(filter.quaternions(), job.next_state + lane, kLanes, nu, job.b + lane, kLanes);
  double covariance[triangle_rows(kMaxFilterStates)];
  for (std::uint32_t r = 0; r < triangle_rows(chunk.nf); ++r)
    covariance[r] = chunk.predicted.covariance[r * kLanes + lane];

  unsigned char used[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < filter.ny(); ++k) used[k] = std::isnan(seen.measured[k]) ? 0 : 1;
  const ErrorDynamics error = {chunk.jacobian + lane, job.b + lane, kLanes, covariance};
  response_->predict(error, seen.period_s, speed, place, seen.input, now);
  response_->correct(error, used, filter.measurement_variance());
}

}  // namespace tiller
