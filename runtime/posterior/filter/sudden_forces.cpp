#include "posterior/filter/sudden_forces.hpp"

#include <algorithm>
#include <cmath>

#include "posterior/filter/mixture_moments.hpp"
#include "posterior/filter/outlier_gate.hpp"
#include "posterior/filter/shove_watch.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// The logarithm of a weighted mean of densities, whose weights sum to one.
class LogMean {
 public:
  void add(double weight, double log_density) {
    if (!(log_density > -kFar)) log_density = -kFar;  // NaN too
    const double top = std::fmax(top_, log_density);
    sum_ = sum_ * math::exp(top_ - top) + weight * math::exp(log_density - top);
    top_ = top;
  }
  double log() const { return sum_ > 0.0 ? top_ + math::log(sum_) : -kFar; }

 private:
  static constexpr double kFar = 1e6;  // as good as impossible, and finite

  double top_ = -kFar, sum_ = 0.0;
};

/// Of the readings that are not NaN, as one lane has predicted each; less a constant.
double log_density(const LaneFilter& filter, const FilterChunk& chunk, std::uint32_t lane, const double* readings,
                   double noise_scale) {
  double squares = 0.0, product = 1.0;
  for (std::uint32_t k = 0; k < filter.ny(); ++k) {
    if (std::isnan(readings[k])) continue;
    const LaneFilter::Residual r = filter.residual(chunk, lane, readings, k);
    const double variance = noise_scale * noise_scale * r.variance;
    squares += r.error * r.error / variance;
    product *= variance;
  }
  return -0.5 * (squares + math::log(product));
}

}  // namespace

SuddenForces* SuddenForces::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                    const DisturbanceStates& disturbances, const DisturbanceStates* at,
                                    std::uint32_t d) {
  if (disturbances.joints() == 0 || (ShoveWatch::longest(config) == 0 && !feels_contacts(config))) return nullptr;
  auto* const c = arena.take<SuddenForces>(1);
  const FilterChunk* const chunk = FilterChunk::lay_out(arena, 1, config, setup, disturbances, at, d);
  auto* const readings = arena.take<double>(config.measurement_count);
  if (c) c->chunk_ = chunk;
  if (c) c->readings_ = readings;
  return c;
}

bool SuddenForces::is_sudden(std::uint32_t f) const {
  const DisturbanceStates& disturbances = *chunk_->lacking;
  return disturbances.wanders(f) && chunk_->law[disturbances.source_of(f) * kLanes] != 0.0;
}

void SuddenForces::follow(const FilterParticles& particles) const {
  const FilterChunk& chunk = *chunk_;
  const DisturbanceStates& disturbances = *chunk.lacking;
  const std::uint32_t n = particles.n(), nf = chunk.nf, nx = nf - disturbances.states();
  double below = 0.0;
  std::uint32_t i = 0;
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    const double share = (l + 0.5) / kLanes;
    while (i + 1 < n && below + particles.weight(i) < share) below += particles.weight(i++);
    for (std::uint32_t p = 0; p < particles.cloud.np; ++p)
      chunk.params[p * kLanes + l] = particles.params_now()[p * n + i];
    chunk.process_scale[l] = particles.process_scale[i];
    for (std::uint32_t f = 0; f < disturbances.states(); ++f)
      if (!is_sudden(f)) chunk.filter.state[(nx + f) * kLanes + l] = particles.state(nx + f)[i];
    for (std::uint32_t f = 0; f < disturbances.drifts(); ++f)  // the parameters have them already
      chunk.filter.state[(nx + disturbances.drift_state(f)) * kLanes + l] = 0.0;
  }
  // these are known, as far as this filter goes
  for (std::uint32_t f = 0; f < disturbances.states(); ++f) {
    if (is_sudden(f)) continue;
    for (std::uint32_t c = 0; c < nf; ++c) {
      const std::uint32_t r = nx + f;
      double* row = chunk.filter.covariance + triangle_row(nf, std::min(r, c), std::max(r, c)) * kLanes;
      std::fill(row, row + kLanes, 0.0);
    }
  }
}

void SuddenForces::begin(const LaneFilter& filter, const FilterStart& start, const FilterParticles& particles) {
  for (std::uint32_t l = 0; l < kLanes; ++l) chunk_->lacking->sudden_law(chunk_->law + l, kLanes);
  follow(particles);
  start.begin_filters(filter, *chunk_, chunk_->filter, {chunk_->params, kLanes}, {chunk_->law, kLanes});
}

void SuddenForces::step(const LaneFilter& filter, const FilterParticles& particles, const Observation& seen,
                        const NoiseScale& noise) {
  follow(particles);
  filter.predict_own(*chunk_, seen, chunk_->filter);
  for (std::uint32_t k = 0; k < filter.ny(); ++k) {
    const double y = seen.measured[k];
    readings_[k] = !std::isnan(y) && !OutlierGate::explains(filter, *chunk_, 0, seen.measured, k, noise.now) ? NAN : y;
  }
  LogMean density;
  for (std::uint32_t l = 0; l < kLanes; ++l)
    density.add(1.0 / kLanes, log_density(filter, *chunk_, l, readings_, noise.calm));
  log_density_ = density.log();
  Observation left = seen;
  left.measured = readings_;
  chunk_->clear_sums();
  filter.correct_own(*chunk_, left, chunk_->filter);
}

double SuddenForces::ahead_of(const LaneFilter& filter, const FilterChunk* chunks, const FilterParticles& particles,
                              const NoiseScale& noise) const {
  LogMean density;
  for (std::uint32_t i = 0; i < particles.n(); ++i) {
    if (!(particles.weight(i) > 0.0)) continue;
    density.add(particles.weight(i), log_density(filter, chunks[i / kLanes], i % kLanes, readings_, noise.calm));
  }
  return log_density_ - density.log();
}

void SuddenForces::read(const LaneFilter& filter, double noise_scale, double* mean, double* sd) const {
  const DisturbanceStates& disturbances = *chunk_->lacking;
  for (std::uint32_t j = 0; j < disturbances.joints(); ++j) {
    const std::uint32_t state = filter.nx() + disturbances.force_state(j);
    const std::uint32_t row = triangle_row(chunk_->nf, state, state);
    MixtureMoments all;
    for (std::uint32_t l = 0; l < kLanes; ++l)
      all.add(1.0 / kLanes, chunk_->filter.state[state * kLanes + l], chunk_->filter.covariance[row * kLanes + l]);
    mean[j] = all.mean;
    sd[j] = all.deviation(noise_scale);
  }
}

}  // namespace tiller
