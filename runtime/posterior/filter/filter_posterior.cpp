// Layout, start, and the part of the tick that filters: predict, gate, correct.

#include "posterior/filter/filter_posterior.hpp"

#include <cmath>
#include <cstring>

#include "posterior/tasks.hpp"

namespace tiller {

namespace {

/// Deviations beyond which a measurement counts as an outlier if no particle can explain it. A normal innovation
/// never gets there; what does is a glitch of the sensor.
constexpr double kGate = 8.0;
/// Outliers in a row after which a measurement is believed after all: then the world has changed, not the sensor.
constexpr std::uint32_t kGateRun = 5;
}  // namespace

FilterPosterior* FilterPosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  const std::uint32_t n = config.posterior.particles, nx = config.model->state_count;
  const std::uint32_t nu = config.model->input_count, np = config.param_count, ns = setup.effect_state_count;
  const std::uint32_t ny = config.measurement_count, triangle = triangle_rows(nx);
  const std::uint32_t slots = config.posterior.window + 1;

  auto* p = arena.take<FilterPosterior>(1);
  auto rows = [&](std::uint32_t count, std::uint32_t stride) {
    return arena.take<double>(std::size_t{count} * stride);
  };
  auto filter = [&](std::uint32_t stride) {
    FilterRows f;
    f.state = rows(nx, stride);
    f.covariance = rows(triangle, stride);
    f.effect_state = rows(ns, stride);
    f.stride = stride;
    return f;
  };

  const Cloud cloud = Cloud::lay_out(arena, config);
  const std::uint32_t d = cloud.d;
  Carried carried;
  carried.filter = filter(n);
  carried.squared_error = rows(1, n);
  carried.log_variance = rows(1, n);
  carried.base_squared_error = rows(1, n);
  carried.base_log_variance = rows(1, n);
  carried.log_likelihood = rows(1, n);

  auto* window = arena.take<Transition>(slots);
  auto* window_history = arena.take<double>(std::size_t{slots} * setup.delay_steps * nu);
  auto* input_history = rows(kHistory, nu);

  auto* chunks = arena.take<Chunk>(n / kChunk);
  for (std::uint32_t i = 0; i < n / kChunk; ++i) {
    Chunk chunk;
    chunk.params = rows(np, kChunk);
    chunk.coordinate = rows(d, kChunk);
    chunk.filter = filter(kChunk);
    chunk.predicted = filter(kChunk);
    chunk.jacobian = rows(nx * nx, kChunk);
    chunk.squared_error = rows(1, kChunk);
    chunk.log_variance = rows(1, kChunk);
    chunk.normalised = rows(ny, kChunk);
    if (has_sensor_effects(config)) {
      chunk.gain = rows(ny, kChunk);
      chunk.offset = rows(ny, kChunk);
    }
    chunk.leaving = rows(ny + 1 + nx + triangle + ns, kChunk);
    if (chunks) chunks[i] = chunk;
  }
  auto* scratch = rows(kScratchRows, n);
  auto* gathered = rows(d, n);
  auto* proposals = arena.take<Proposal>(n / 2);
  auto* use_lane = arena.take<unsigned char>(n);
  // a cloud that does not learn has innovations that go with whatever its parameters are off by
  const bool tested = config.posterior.adequacy != 0 && config.posterior.enabled != 0;
  AdequacyTest* adequacy = tested ? AdequacyTest::lay_out(arena, config, false) : nullptr;
  DisturbanceResponse* response = tested ? DisturbanceResponse::lay_out(arena, config) : nullptr;
  auto* input_jacobian = rows(tested ? nx * nu : 0, kChunk);
  if (arena.measuring() || !arena.fits()) return nullptr;

  p->config_ = &config;
  p->setup_ = setup;
  p->table_ = &table;
  p->filter_ = &filter_table();
  p->hooks_ = hooks;
  p->n_ = n;
  p->nx_ = nx;
  p->nu_ = nu;
  p->np_ = np;
  p->ns_ = ns;
  p->ny_ = ny;
  p->triangle_ = triangle;
  p->d_ = d;
  for (std::uint32_t k = 0; k < ny; ++k)
    p->measurement_variance_[k] = config.measurement_sd[k] * config.measurement_sd[k];
  p->enabled_ = config.posterior.enabled != 0;
  p->cloud_ = cloud;
  p->carried_ = carried;
  p->window_ = Ring<Transition>(window, slots);
  p->window_history_ = window_history;
  p->input_history_ = input_history;
  p->chunks_ = chunks;
  p->scratch_ = scratch;
  p->gathered_ = gathered;
  p->proposals_ = proposals;
  p->use_lane_ = use_lane;
  p->adequacy_ = adequacy;
  p->response_ = response;
  p->input_jacobian_ = input_jacobian;
  p->reset();
  return p;
}

void FilterPosterior::reset() {
  cloud_.draw_prior();
  for (std::uint32_t k = 0; k < n_; ++k) {
    carried_.squared_error[k] = carried_.log_variance[k] = 0.0;
    carried_.base_squared_error[k] = carried_.base_log_variance[k] = 0.0;
    carried_.log_likelihood[k] = 0.0;
  }
  window_.clear();
  window_begin_ = 0;
  window_exact_ = true;
  past_.clear();
  started_ = false;
  tick_ = scalars_ = 0;
  exponent_ = 1.0;
  noise_scale_ = 1.0;
  acceptance_ = 0.0;
  cursor_ = moved_ = 0;
  resamplings_ = gated_ = 0;
  for (std::uint32_t& run : gate_run_) run = 0;
  clear_adequacy();
  for (std::uint32_t k = 0; k < ny_; ++k) start_measured_[k] = NAN;
  begin_all_filters();
}

void FilterPosterior::begin_all_filters() {
  for (std::uint32_t c = 0; c < n_ / kChunk; ++c) {
    const std::uint32_t at = c * kChunk;
    map_sensors(chunks_[c], cloud_.params + at, n_);
    begin_filters(chunks_[c],
                  {carried_.filter.state + at, carried_.filter.covariance + at, carried_.filter.effect_state + at, n_},
                  scratch_row(0) + at, scratch_row(1) + at);
  }
}

/// The filters at a start(): the configured state, corrected by the first measurement, which does not count into
/// the likelihood (of no parameter but a sensor's, and of these the others tell more). The chunk says how the sensors
/// read.
void FilterPosterior::begin_filters(const Chunk& chunk, FilterRows rows, double* squared_error,
                                    double* log_variance) const {
  constexpr std::uint32_t lanes = kChunk;
  for (std::uint32_t l = 0; l < lanes; ++l) squared_error[l] = log_variance[l] = 0.0;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double sd = config_->initial_state_sd[r];
    for (std::uint32_t l = 0; l < lanes; ++l) rows.state[r * rows.stride + l] = config_->initial_state[r];
    for (std::uint32_t c = r; c < nx_; ++c) {
      double* row = rows.covariance + triangle_row(nx_, r, c) * rows.stride;
      for (std::uint32_t l = 0; l < lanes; ++l) row[l] = r == c ? sd * sd : 0.0;
    }
  }
  for (std::uint32_t i = 0; i < ns_; ++i)
    for (std::uint32_t l = 0; l < lanes; ++l) rows.effect_state[i * rows.stride + l] = 0.0;

  CorrectJob job = correct_job(start_measured_, chunk);
  job.from = job.to = rows;
  job.squared_error = squared_error;
  job.log_variance = log_variance;
  filter_->correct(job);
  for (std::uint32_t l = 0; l < lanes; ++l) squared_error[l] = log_variance[l] = 0.0;
}

tiller_status_t FilterPosterior::start(const double* measured) {
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (std::isinf(measured[k])) return tiller_status_sensor_not_finite;
  if (started_) close_window();
  std::memcpy(start_measured_, measured, ny_ * sizeof(double));
  begin_all_filters();
  for (std::uint32_t i = 0; i < kHistory; ++i)
    for (std::uint32_t j = 0; j < nu_; ++j) input_history_[i * nu_ + j] = config_->safety.safe_command[j];
  for (std::uint32_t& run : gate_run_) run = 0;
  if (adequacy_) {
    adequacy_->begin();
    response_->begin();
  }
  started_ = true;
  return tiller_status_ok;
}

tiller_status_t FilterPosterior::update(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  const tiller_status_t refusal = check_transition(*config_, transition);
  if (refusal != tiller_status_ok) return refusal;
  ++tick_;
  now_ = transition;
  predict();
  gate(now_);
  if (adequacy_) test_innovation();
  std::memcpy(scratch_row(2), carried_.squared_error, n_ * sizeof(double));
  std::memcpy(scratch_row(3), carried_.log_variance, n_ * sizeof(double));
  correct();
  const tiller_status_t status = reweight();
  if (status != tiller_status_posterior_degenerate && enabled_ && config_->posterior.moves_per_tick && d_) {
    remember_transition();
    move();
  }
  remember_input(now_.input);
  return status;
}

void FilterPosterior::predict() {
  for_each_chunk(hooks_, n_ / kChunk, n_ >= kWorthThreads, [this](std::uint32_t c) { predict_chunk(c); });
}

void FilterPosterior::predict_chunk(std::uint32_t c) const {
  const Chunk& chunk = chunks_[c];
  const std::uint32_t at = c * kChunk;
  map_sensors(chunk, cloud_.params + at, n_);
  table_->linearise(*config_->model, predict_job(chunk, at));
  predict_covariance(chunk, now_.period_s, carried_.filter.covariance + at, n_);
}

/// The step of particles at .. at + kChunk - 1 over the transition that is being taken in.
LineariseJob FilterPosterior::predict_job(const Chunk& chunk, std::uint32_t at) const {
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = kChunk;
  job.period_s = now_.period_s;
  job.state = {carried_.filter.state + at, n_};
  job.params = {cloud_.params + at, n_};
  job.effect_state = {carried_.filter.effect_state + at, n_};
  job.control = {now_.input, 0};
  job.history = input_history_;
  job.next_state = chunk.predicted.state;
  job.next_effect_state = chunk.predicted.effect_state;
  job.a = chunk.jacobian;
  return job;
}

/// P' = A P A^T + Q with the chunk's Jacobian, into the chunk. Process noise grows with time, as a random walk's.
void FilterPosterior::predict_covariance(const Chunk& chunk, double period_s, const double* covariance,
                                         std::uint32_t stride) const {
  double variance[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < nx_; ++i) variance[i] = config_->process_sd[i] * config_->process_sd[i] * period_s;
  PredictJob job;
  job.nx = nx_;
  job.lanes = kChunk;
  job.a = chunk.jacobian;
  job.a_stride = kChunk;
  job.covariance = covariance;
  job.covariance_stride = stride;
  job.process_variance = variance;
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

CorrectJob FilterPosterior::correct_job(const double* measured, const Chunk& chunk) const {
  CorrectJob job;
  job.nx = nx_;
  job.ns = ns_;
  job.ny = ny_;
  job.lanes = kChunk;
  job.gain = chunk.gain;
  job.offset = chunk.offset;
  job.angle_mask = config_->model->angle_mask;
  job.measured_state = config_->measured_state;
  job.measured = measured;
  job.variance = measurement_variance_;
  return job;
}

/// A value that is beyond kGate deviations for every particle is a glitch: it is treated as missing, here and in
/// every later rerun. One particle that can explain it makes it data.
void FilterPosterior::gate(Transition& t) {
  for (std::uint32_t k = 0; k < ny_; ++k) {
    if (std::isnan(t.measured[k])) continue;
    if (gate_run_[k] >= kGateRun || explained(t, k)) {
      gate_run_[k] = 0;
      continue;
    }
    t.measured[k] = NAN;
    ++gate_run_[k];
    ++gated_;
  }
}

bool FilterPosterior::explained(const Transition& t, std::uint32_t k) const {
  const std::uint32_t state = config_->measured_state[k];
  const double scale = std::fmax(1.0, noise_scale_ * noise_scale_);
  const std::uint32_t row = triangle_row(nx_, state, state);
  for (std::uint32_t i = 0; i < n_; ++i) {
    const Chunk& chunk = chunks_[i / kChunk];
    const std::uint32_t lane = i % kChunk;
    const MeasurementMap map = sensor(chunk, k, lane);
    const double predicted = map.of(chunk.predicted.state[state * kChunk + lane]);
    const double error = state_difference(*config_->model, state, t.measured[k], predicted);
    const double variance =
        map.gain * map.gain * chunk.predicted.covariance[row * kChunk + lane] + measurement_variance_[k];
    // the first particle usually ends the search
    if (cloud_.weight[i] > 0.0 && error * error <= kGate * kGate * scale * variance) return true;
  }
  return false;
}

void FilterPosterior::correct() {
  for_each_chunk(hooks_, n_ / kChunk, n_ >= kWorthThreads, [this](std::uint32_t c) { correct_chunk(c); });
  for (std::uint32_t k = 0; k < ny_; ++k) scalars_ += std::isnan(now_.measured[k]) ? 0u : 1u;
}

void FilterPosterior::correct_chunk(std::uint32_t c) const {
  const std::uint32_t at = c * kChunk;
  CorrectJob job = correct_job(now_.measured, chunks_[c]);
  job.from = chunks_[c].predicted;
  job.to = {carried_.filter.state + at, carried_.filter.covariance + at, carried_.filter.effect_state + at, n_};
  job.squared_error = carried_.squared_error + at;
  job.log_variance = carried_.log_variance + at;
  filter_->correct(job);
}

void FilterPosterior::remember_transition() {
  const auto slot = static_cast<std::size_t>(window_.end() % window_.capacity());
  const std::size_t row = std::size_t{setup_.delay_steps} * nu_;
  std::memcpy(window_history_ + slot * row, input_history_, sizeof(double) * row);
  window_.push() = now_;
}

void FilterPosterior::remember_input(const double* input) {
  std::memmove(input_history_ + nu_, input_history_, sizeof(double) * (kHistory - 1) * nu_);
  std::memcpy(input_history_, input, sizeof(double) * nu_);
}

}  // namespace tiller
