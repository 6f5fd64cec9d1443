// Layout, and the part of the tick that filters: predict, gate, correct.

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

/// Deviations at which the prior of the noises' ratio is cut: beyond, process noise is as good as none, or all there
/// is.
constexpr double kWidestRatio = 2.0;

std::uint32_t round_up(std::uint32_t value, std::uint32_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

/// The ratio of process to sensor noise, where there is process noise whose size may be misstated.
ExtraCoordinates noise_ratio(const tiller_config_t& config) {
  ExtraCoordinates extra;
  bool any = false;
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) any = any || config.process_sd[i] > 0.0;
  if (!any || !config.posterior.enabled || !(config.posterior.noise_ratio_sd > 0.0)) return extra;
  extra.count = 1;
  const double sd = config.posterior.noise_ratio_sd;
  extra.prior[0] = {tiller_prior_normal, 0, 0.0, sd, -kWidestRatio * sd, kWidestRatio * sd};
  return extra;
}

}  // namespace

FilterPosterior* FilterPosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  const std::uint32_t n = config.posterior.particles, nx = config.model->state_count;
  const std::uint32_t nu = config.model->input_count, np = config.param_count, ns = setup.effect_state_count;
  const std::uint32_t ny = config.measurement_count;
  const std::uint32_t slots = config.posterior.window + 1, move_lanes = round_up(n / 2, kChunk);

  auto* p = arena.take<FilterPosterior>(1);
  const FilterDiscrepancy discrepancy(config, setup, table);
  const std::uint32_t forces = discrepancy.forces(), nf = nx + forces, triangle = triangle_rows(nf);
  constexpr std::uint32_t sums = ScaleEvidence::kRows;
  auto rows = [&](std::uint32_t count, std::uint32_t stride) {
    return arena.take<double>(std::size_t{count} * stride);
  };
  auto filter = [&](std::uint32_t stride) {
    FilterRows f;
    f.state = rows(nf, stride);
    f.covariance = rows(triangle, stride);
    f.effect_state = rows(ns, stride);
    f.stride = stride;
    return f;
  };

  const ExtraCoordinates extra = noise_ratio(config);
  const Cloud cloud = Cloud::lay_out(arena, config, extra);
  const std::uint32_t d = cloud.d;
  Carried carried;
  carried.filter = filter(n);
  carried.process_scale = rows(1, n);
  carried.sums = rows(sums, n);
  carried.base = rows(sums, n);
  carried.log_likelihood = rows(1, n);

  auto* window = arena.take<Kept>(slots);
  auto* window_history = arena.take<double>(std::size_t{slots} * setup.delay_steps * nu);
  auto* input_history = rows(kHistory, nu);
  const FilterSummary summary = FilterSummary::lay_out(arena, d, nf, ns);
  const NormalLaw before = NormalLaw::lay_out(arena, d);

  auto* chunks = arena.take<Chunk>(n / kChunk);
  for (std::uint32_t i = 0; i < n / kChunk; ++i) {
    Chunk chunk;
    chunk.params = rows(np + 1, kChunk);
    chunk.coordinate = rows(d, kChunk);
    chunk.filter = filter(kChunk);
    chunk.predicted = filter(kChunk);
    chunk.process_scale = rows(1, kChunk);
    chunk.jacobian = rows(nf * nf, kChunk);
    chunk.sums = rows(sums, kChunk);
    chunk.normalised = rows(ny, kChunk);
    chunk.unit = rows(nx * discrepancy.joints(), kChunk);
    chunk.push = rows(nx * forces, kChunk);
    if (has_sensor_effects(config)) {
      chunk.gain = rows(ny, kChunk);
      chunk.offset = rows(ny, kChunk);
    }
    if (chunks) chunks[i] = chunk;
  }
  auto* scratch = rows(sums + 2, n);
  auto* proposals = arena.take<Proposal>(n / 2);
  auto* proposed_sums = rows(sums, move_lanes);
  auto* move_coordinate = rows(d, move_lanes);
  auto* point_innovation = rows(ny + 1, summary.design().points());
  // a cloud that does not learn has innovations that go with whatever its parameters are off by
  const bool tested = config.posterior.adequacy != 0 && config.posterior.enabled != 0;
  AdequacyTest* adequacy = tested ? AdequacyTest::lay_out(arena, config, false) : nullptr;
  DisturbanceResponse* response = tested ? DisturbanceResponse::lay_out(arena, config) : nullptr;
  auto* response_scratch = rows(tested ? nx + nx * nx + nx * nu : 0, kChunk);
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
  p->forces_ = forces;
  p->nf_ = nf;
  for (std::uint32_t k = 0; k < ny; ++k)
    p->measurement_variance_[k] = config.measurement_sd[k] * config.measurement_sd[k];
  p->enabled_ = config.posterior.enabled != 0;
  p->has_ratio_ = extra.count > 0;
  p->keep_ = config.posterior.forgetting_count > 0 ? config.posterior.forgetting[0] : 1.0;
  p->cloud_ = cloud;
  p->carried_ = carried;
  p->evidence_ = ScaleEvidence(config);
  p->window_ = Ring<Kept>(window, slots);
  p->window_history_ = window_history;
  p->input_history_ = input_history;
  p->summary_ = summary;
  p->before_ = before;
  p->discrepancy_ = discrepancy;
  p->rest_ = RestGuard(config);
  p->chunks_ = chunks;
  p->scratch_ = scratch;
  p->proposals_ = proposals;
  p->proposed_sums_ = proposed_sums;
  p->move_coordinate_ = move_coordinate;
  p->move_lanes_ = move_lanes;
  p->point_innovation_ = point_innovation;
  p->adequacy_ = adequacy;
  p->response_ = response;
  p->response_scratch_ = response_scratch;
  p->reset();
  return p;
}

void FilterPosterior::reset() {
  cloud_.prior.believe_before(nullptr);
  cloud_.draw_prior();
  const std::size_t all = std::size_t{rows_} * n_;
  std::memset(carried_.sums, 0, sizeof(double) * all);
  std::memset(carried_.base, 0, sizeof(double) * all);
  std::memset(carried_.log_likelihood, 0, sizeof(double) * n_);
  for (std::uint32_t k = 0; k < n_; ++k)
    carried_.process_scale[k] = has_ratio_ ? ratio_scale(cloud_.coordinate[cloud_.named * n_ + k]) : 1.0;
  evidence_.believe_configuration();
  evidence_.clear();
  window_.clear();
  window_begin_ = 0;
  window_exact_ = true;
  summary_.clear();
  discrepancy_.clear();
  for (double& variance : force_drift_) variance = 0.0;
  started_ = false;
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
  now_.transition = transition;
  predict();
  const bool doubted = gate(now_.transition);
  const bool resting = moves && rest_.resting(now_.transition);
  now_.weight = resting || sticks() ? 0.0 : 1.0;
  if (adequacy_ && !resting) test_innovation();
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
  remember_input(now_.transition.input);
  watch_change(resting);
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
  step.transition = &now_.transition;
  step.from = carried_lanes(at);
  step.params = {cloud_.params + at, n_};
  step.process_scale = carried_.process_scale + at;
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
  return any && !left;
}

bool FilterPosterior::explained(const Transition& t, std::uint32_t k) const {
  const std::uint32_t state = config_->measured_state[k];
  const double scale = std::fmax(1.0, noise_scale_ * noise_scale_);
  const std::uint32_t row = triangle_row(nf_, state, state);
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
  if (forces_ == 0) return false;
  const std::uint32_t i = heaviest();
  return discrepancy_.sticks(discrepancy_job(chunks_[i / kChunk], particle_step(i / kChunk)), i % kChunk);
}

void FilterPosterior::remember_transition() {
  const auto slot = static_cast<std::size_t>(window_.end() % window_.capacity());
  const std::size_t row = std::size_t{setup_.delay_steps} * nu_;
  std::memcpy(window_history_ + slot * row, input_history_, sizeof(double) * row);
  window_.push() = now_;
}

const double* FilterPosterior::history_of(std::uint64_t index) const {
  return window_history_ + (index % window_.capacity()) * setup_.delay_steps * nu_;
}

void FilterPosterior::remember_input(const double* input) {
  std::memmove(input_history_ + nu_, input_history_, sizeof(double) * (kHistory - 1) * nu_);
  std::memcpy(input_history_, input, sizeof(double) * nu_);
}

namespace {
Posterior* lay_out_engine(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  return FilterPosterior::lay_out(arena, config, setup, table, hooks);
}
}  // namespace

extern const PosteriorTable filter_posterior;
const PosteriorTable filter_posterior = {lay_out_engine};

}  // namespace tiller
