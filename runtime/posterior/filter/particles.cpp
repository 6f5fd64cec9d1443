#include "posterior/filter/particles.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "rollout/attitude.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

constexpr std::uint32_t kLanes = FilterChunk::kLanes;
/// Standard deviations at which the prior of the noises' ratio is cut: beyond, process noise is as good as none, or all
/// there is.
constexpr double kWidestRatio = 2.0;

/// The ratio, then sizes, time and rates of what the model lacks.
ExtraCoordinates own_coordinates(const tiller_config_t& config, const DisturbanceStates& disturbances) {
  ExtraCoordinates extra;
  if (infers_noise_ratio(config)) {
    const double sd = config.posterior.noise_ratio_sd;
    extra.prior[extra.count++] = {tiller_prior_normal, 0, 0.0, sd, -kWidestRatio * sd, kWidestRatio * sd};
  }
  for (std::uint32_t row = 0; config.posterior.enabled && row < disturbances.coordinates(); ++row)
    extra.prior[extra.count++] = disturbances.law_prior(row);
  return extra;
}

}  // namespace

bool infers_noise_ratio(const tiller_config_t& config) {
  bool any = false;
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) any = any || config.process_sd[i] > 0.0;
  return any && config.posterior.enabled && config.posterior.noise_ratio_sd > 0.0;
}

FilterParticles FilterParticles::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                         const DisturbanceStates& disturbances, const DisturbanceStates* at) {
  const std::size_t n = config.posterior.particles;
  FilterParticles p;
  p.disturbances = at;
  p.has_ratio = infers_noise_ratio(config);
  p.nf = config.model->state_count + disturbances.states();
  p.ns = setup.effect_state_count;
  p.cloud = Cloud::lay_out(arena, config, own_coordinates(config, disturbances));
  p.filter = lay_out_filters(arena, p.nf, p.ns, config.posterior.particles);
  p.process_scale = arena.take<double>(n);
  if (disturbances.states() > 0) p.laws = arena.take<double>(disturbances.law_rows() * n);
  if (disturbances.drifts() > 0) p.present = arena.take<double>(config.param_count * n);
  p.sums = arena.take<double>(kRows * n);
  p.base = arena.take<double>(kRows * n);
  if (disturbances.joints() > 0) p.recent = arena.take<double>(kRows * n);
  p.log_likelihood = arena.take<double>(n);
  p.scratch = arena.take<double>((kRows + 2) * n);
  p.before = NormalLaw::lay_out(arena, p.cloud.d);
  return p;
}

void FilterParticles::draw_prior() {
  cloud.prior.believe_before(nullptr);
  cloud.draw_prior();
  for (std::uint32_t k = 0; k < n(); ++k)
    read_own(cloud.coordinate + k, n(), process_scale + k, laws ? laws + k : nullptr, n());
}

void FilterParticles::clear_sums() {
  std::memset(sums, 0, sizeof(double) * kRows * n());
  std::memset(base, 0, sizeof(double) * kRows * n());
  if (recent) std::memset(recent, 0, sizeof(double) * kRows * n());
  std::memset(log_likelihood, 0, sizeof(double) * n());
}

void FilterParticles::forget(double keep) {
  for (std::size_t i = 0; i < std::size_t{kRows} * n(); ++i) {
    sums[i] *= keep;
    base[i] *= keep;
    if (recent) recent[i] *= keep;
  }
}

void FilterParticles::permute() {
  const auto permute_rows = [this](double* rows, std::uint32_t count) {
    for (std::uint32_t i = 0; i < count; ++i) cloud.permute(rows + std::size_t{i} * n());
  };
  permute_rows(filter.state, nf);
  permute_rows(filter.covariance, triangle_rows(nf));
  permute_rows(filter.effect_state, ns);
  permute_rows(process_scale, 1);
  permute_rows(laws, disturbances->law_rows());
  permute_rows(sums, kRows);
  permute_rows(base, kRows);
  if (recent) permute_rows(recent, kRows);
  permute_rows(log_likelihood, 1);
}

void FilterParticles::draw_again(std::uint64_t tick, std::uint64_t change) {
  cloud.fit_law(before);
  cloud.resample(tick);
  permute();
  cloud.prior.believe_before(nullptr);
  for (std::uint32_t i = 1; i < n(); i += 2) {
    Rng rng(cloud.config->seed, kRngPrior, (std::uint64_t{1} << 40) + change * n() + i);
    double v[kMaxCoordinates];
    cloud.prior.draw_one(rng, v);
    for (std::uint32_t j = cloud.named; j < cloud.d; ++j) v[j] = cloud.coordinate[j * n() + i];
    cloud.set_coordinate(i, v);
  }
  cloud.prior.believe_before(&before);
}

void FilterParticles::note_drift() {
  if (!present) return;
  std::memcpy(present, cloud.params, sizeof(double) * cloud.np * n());
  const std::uint32_t nx = nf - disturbances->states();
  for (std::uint32_t i = 0; i < disturbances->drifts(); ++i) {
    const std::uint32_t param = disturbances->drift_param(i);
    double* row = present + std::size_t{param} * n();
    const double* by = state(nx + disturbances->drift_state(i));
    for (std::uint32_t k = 0; k < n(); ++k) row[k] = disturbances->drifted(param, row[k], by[k]);
  }
}

double FilterParticles::mean(const double* row) const {
  double sum = 0.0;
  for (std::uint32_t k = 0; k < n(); ++k) sum += cloud.weight[k] * row[k];
  return sum;
}

std::uint32_t FilterParticles::heaviest() const {
  std::uint32_t heaviest = 0;
  for (std::uint32_t i = 1; i < n(); ++i)
    if (cloud.weight[i] > cloud.weight[heaviest]) heaviest = i;
  return heaviest;
}

void FilterParticles::differ(std::uint32_t i, std::uint32_t about, double* off) const {
  filter_difference({filter.state, filter.covariance, filter.effect_state, n()}, cloud.config->model->quaternion_mask,
                    nf, i, about, off);
}

FilterRows FilterParticles::lanes(std::uint32_t c) const {
  const std::uint32_t at = c * kLanes;
  // without effects that have states there are none, and no offset to them
  double* const effects = filter.effect_state;
  return {filter.state + at, filter.covariance + at, effects != nullptr ? effects + at : nullptr, n()};
}

Lanes<double> FilterParticles::laws_of(std::uint32_t c) const {
  if (!laws) return {};
  return {laws + c * kLanes, n()};
}

void FilterParticles::read_own(const double* coordinate, std::uint32_t stride, double* scale, double* law,
                               std::uint32_t law_stride) const {
  const double* own = coordinate + std::size_t{cloud.named} * stride;
  *scale = has_ratio ? math::exp(2.0 * own[0]) : 1.0;
  if (!law) return;
  if (cloud.config->posterior.enabled)
    disturbances->read_law(has_ratio ? own + stride : own, stride, law, law_stride);
  else
    disturbances->fixed_law(law, law_stride);
}

void FilterParticles::place(const FilterChunk& chunk, std::uint32_t l, const double* coordinate) const {
  for (std::uint32_t i = 0; i < cloud.np; ++i) chunk.params[i * kLanes + l] = cloud.params[i * n()];
  for (std::uint32_t j = 0; j < cloud.d; ++j) chunk.coordinate[j * kLanes + l] = coordinate[j];
  for (std::uint32_t j = 0; j < cloud.named; ++j) {
    const std::uint32_t i = cloud.inferred[j];
    chunk.params[i * kLanes + l] = from_coordinate(cloud.config->priors[i], coordinate[j]);
  }
  read_own(coordinate, 1, chunk.process_scale + l, chunk.law ? chunk.law + l : nullptr, kLanes);
}

void FilterParticles::take_over(std::uint32_t i, const FilterChunk& chunk, std::uint32_t l, const double* coordinate) {
  const auto copy = [&](double* to, const double* from, std::uint32_t rows) {
    for (std::uint32_t r = 0; r < rows; ++r) to[r * n() + i] = from[r * kLanes + l];
  };
  cloud.set_coordinate(i, coordinate);
  copy(process_scale, chunk.process_scale, 1);
  copy(laws, chunk.law, disturbances->law_rows());
  copy(filter.state, chunk.filter.state, nf);
  copy(filter.covariance, chunk.filter.covariance, triangle_rows(nf));
  copy(filter.effect_state, chunk.filter.effect_state, ns);
}

}  // namespace tiller
