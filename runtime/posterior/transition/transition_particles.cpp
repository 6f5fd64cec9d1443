#include "posterior/transition/transition_particles.hpp"

#include <cstring>

#include "posterior/transition/transition_lanes.hpp"

namespace tiller {

TransitionParticles TransitionParticles::lay_out(Arena& arena, const tiller_config_t& config,
                                                 const Evidence& evidence) {
  const std::size_t n = config.posterior.particles;
  TransitionParticles p;
  p.rows = evidence.rows();
  p.cloud = Cloud::lay_out(arena, config);
  p.params = arena.take<float>(config.param_count * n);
  p.total = arena.take<double>(p.rows * n);
  p.ring = arena.take<double>(p.rows * n);
  p.log_likelihood = arena.take<double>(n);
  p.fresh = arena.take<double>(p.rows * n);
  p.base = arena.take<double>(n);
  p.gain = arena.take<double>(n);
  return p;
}

void TransitionParticles::draw_prior() {
  cloud.draw_prior();
  for (std::size_t i = 0; i < std::size_t{cloud.np} * n(); ++i) params[i] = static_cast<float>(cloud.params[i]);
  std::memset(total, 0, sizeof(double) * rows * n());
  std::memset(ring, 0, sizeof(double) * rows * n());
  std::memset(log_likelihood, 0, sizeof(double) * n());
}

void TransitionParticles::clear_fresh() { std::memset(fresh, 0, sizeof(double) * rows * n()); }

void TransitionParticles::add_fresh(double factor) {
  transition_table().add_scaled(rows * n(), factor, fresh, total);
  transition_table().add_scaled(rows * n(), factor, fresh, ring);
}

void TransitionParticles::forget(double keep) {
  for (std::size_t i = 0; i < std::size_t{rows} * n(); ++i) {
    total[i] *= keep;
    ring[i] *= keep;
  }
}

void TransitionParticles::resample(std::uint64_t tick) {
  cloud.resample_in_place(tick);
  for (std::uint32_t r = 0; r < rows; ++r) {
    cloud.permute_in_place(total + r * n());
    cloud.permute_in_place(ring + r * n());
  }
  for (std::uint32_t j = 0; j < cloud.named; ++j) cloud.permute_in_place(params + cloud.inferred[j] * n());
  cloud.permute_in_place(log_likelihood);
}

bool TransitionParticles::split_weights(double exponent, const double* likelihood, double* to) {
  return transition_table().split_weights(n(), cloud.log_weight, log_likelihood, exponent, likelihood, base, to);
}

}  // namespace tiller
