// What rollouts do not follow from their hypothesis: errors of the start and of the forces, and process noise.
// Attitudes start as they are.

#include <cmath>

#include "core/rng.hpp"
#include "planners/sampler.hpp"
#include "rollout/attitude.hpp"
#include "rollout/state_spread.hpp"

namespace tiller {
namespace {

/// Lower Cholesky factor of a positive semidefinite matrix (n x n); columns without variance are zero.
void factorise(std::uint32_t n, const double* matrix, double* factor) {
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c < n; ++c) {
      double sum = matrix[r * n + c];
      for (std::uint32_t i = 0; i < c && c <= r; ++i) sum -= factor[r * n + i] * factor[c * n + i];
      double& entry = factor[r * n + c];
      const double pivot = c < r ? factor[c * n + c] : 0.0;
      if (c > r)
        entry = 0.0;
      else if (c == r)
        entry = sum > 0.0 ? std::sqrt(sum) : 0.0;
      else
        entry = pivot > 0.0 ? sum / pivot : 0.0;
    }
}

/// factor times normal numbers.
void draw(Rng& rng, std::uint32_t n, const double* factor, double* x) {
  double normal[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < n; ++i) normal[i] = rng.normal();
  for (std::uint32_t r = 0; r < n; ++r) {
    x[r] = 0.0;
    for (std::uint32_t c = 0; c <= r; ++c) x[r] += factor[r * n + c] * normal[c];
  }
}

/// By how much the forces that wander are off, in one hypothesis. It fades as they do; what is yet to come is not
/// drawn.
void draw_force_errors(Sampler& s, Rng& rng, const StateSpread& spread, std::uint32_t m) {
  const std::uint32_t forces = spread.forces < s.setup->fading ? spread.forces : s.setup->fading;
  for (std::uint32_t j = 0; j < forces; ++j) {
    const std::uint32_t row = s.setup->fading_param + j;
    s.lane_params[row * s.padded + m] = s.particle_params[m * s.params + row] +=
        static_cast<float>(spread.force_sd[j] * rng.normal());
  }
}

}  // namespace

void draw_rollout_noise(Sampler& s) {
  const std::uint32_t nx = s.states, rows = s.grid.horizon * nx;
  double start[TILLER_MAX_STATES * TILLER_MAX_STATES] = {}, process[TILLER_MAX_STATES * TILLER_MAX_STATES] = {};
  const StateSpread* spread = s.request->belief->spread;
  if (spread) {
    factorise(nx, spread->covariance, start);
    factorise(nx, spread->process, process);
  }
  double x[TILLER_MAX_STATES];
  for (std::uint32_t m = 0; m < s.padded; ++m) {
    const std::uint32_t particle = m < s.particles ? m : 0;
    if (m >= s.particles) {  // the padding repeats particle 0
      for (std::uint32_t i = 0; i < nx; ++i) s.lane_state[i * s.padded + m] = s.lane_state[i * s.padded];
      for (std::uint32_t r = 0; r < rows; ++r) s.lane_noise[r * s.padded + m] = s.lane_noise[r * s.padded];
      for (std::uint32_t r = 0; r < s.params; ++r) s.lane_params[r * s.padded + m] = s.lane_params[r * s.padded];
      continue;
    }
    Rng rng(s.seed, kRngRollouts, s.request->tick * 64 + particle);
    draw(rng, nx, start, x);
    for (std::uint32_t i = 0; i < nx; ++i)
      if (((quaternion_states(s.model->quaternion_mask) >> i) & 1u) == 0)
        s.lane_state[i * s.padded + m] = s.particle_state[m * nx + i] += static_cast<float>(x[i]);
    for (std::uint32_t k = 0; k < s.grid.horizon; ++k) {
      draw(rng, nx, process, x);
      for (std::uint32_t i = 0; i < nx; ++i)
        s.noise[std::size_t{m} * rows + k * nx + i] = s.lane_noise[(k * nx + i) * s.padded + m] =
            static_cast<float>(x[i]);
    }
    if (spread) draw_force_errors(s, rng, *spread, m);
  }
}

}  // namespace tiller
