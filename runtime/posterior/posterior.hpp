#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// What happened between two measurements.
struct Transition {
  double period_s = 0.0;                       // measured
  double input[TILLER_MAX_INPUTS] = {};        // mean command in force over the period
  double measured[TILLER_MAX_MEASUREMENTS] = {};  // (ny) at its end; NaN: missing
};

/// Particles over the named parameters, each carrying its own extended Kalman filter of the state and the states of
/// its effects. See docs/posterior.md for the equations.
class Posterior {
 public:
  /// Lays out N particles and the window; null while the arena measures.
  static Posterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                            const RolloutTable& table, const tiller_hooks_t* hooks);

  /// Draws the particles from the prior; forgets everything.
  void reset();
  /// First measurement after reset (or after a gap: parameters are kept, filters begin anew).
  tiller_status_t start(const double* measured);
  /// Takes in one transition. ok, tempered, or posterior_degenerate (nothing was changed but the filters).
  tiller_status_t update(const Transition& transition);

  bool started() const;
  /// Weighted moments; every pointer nullable. params (np), state (nx).
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const;
  void covariance(double* covariance) const;  // (np x np)
  double quantile(std::uint32_t param, double q) const;
  double effective_samples() const;
  double exponent() const;
  double noise_scale() const;
  double acceptance() const;
  std::uint64_t resamplings() const;
  std::uint32_t size() const;
  void particle(std::uint32_t index, double* params, double* state, double* weight) const;
  /// Chooses `count` particles by stratified sampling from the weights (stream `tick`), into rows of `count`:
  /// params (np x count), state (nx x count), effect_state (ns x count); history (delay_steps x nu), newest first.
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const;
};

}  // namespace tiller
