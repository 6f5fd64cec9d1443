#pragma once

#include <cstdint>

#include "posterior/transition/transition_particles.hpp"
#include "posterior/transition/transition_ring.hpp"
#include "rollout/residual.hpp"

namespace tiller {

/// Sums of residuals over transitions of the ring, of all particles or of the moves. They are spread over
/// hooks.parallel_for.
class ResidualSums {
 public:
  /// `lanes`: of the moves, at most. Ring and evidence stand there once there is memory.
  static ResidualSums lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                              const RolloutTable& table, const tiller_hooks_t* hooks, const Evidence& evidence,
                              std::uint32_t lanes);
  void bind(const TransitionRing& ring, const Evidence& evidence) {
    ring_ = &ring;
    evidence_ = &evidence;
  }

  void begin_tick() { work_ = 0; }
  /// Steps of the model that were taken since.
  std::uint64_t work() const { return work_; }
  /// Those that the sums of one transition take: with a discrepancy, its predecessor's too.
  std::uint32_t steps_of_one() const { return steps_of_one_; }

  /// sums (rows x stride) += those over transitions begin .. end - 1.
  void sum(Lanes<float> params, std::uint32_t lanes, std::uint64_t begin, std::uint64_t end, double* sums,
           std::uint32_t stride);
  /// Of all particles, into what they have fresh.
  void sum_fresh(const TransitionParticles& particles, std::uint64_t begin, std::uint64_t end) {
    sum({particles.params, particles.n()}, particles.n(), begin, end, particles.fresh, particles.n());
  }
  /// Residuals (nx x lanes) at one transition.
  void residuals(Lanes<float> params, std::uint32_t lanes, std::uint32_t slot, float* residual);
  /// Of the newest transition, as the sums of it alone left it for all N particles, whitened.
  double newest(std::uint32_t n, std::uint32_t particle, std::uint32_t row) const;

 private:
  static constexpr std::uint32_t kChunk = 64;  // lanes of a task
  static constexpr std::uint32_t kBlock = 32;  // transitions whose residuals are at hand at a time

  /// Where the sums of a run of lanes go.
  struct Job {
    Lanes<float> params;
    std::uint32_t lanes = 0;
    std::uint32_t slot = 0, count = 0;  // of the ring; does not wrap
    double* sums = nullptr;             // (rows x lanes)
    std::uint32_t stride = 0;
  };

  void sum_slots(const Job& job);
  void sum_chunk(const Job& job, std::uint32_t chunk) const;
  void sum_squares(const Job& job, std::uint32_t first, ResidualJob& steps) const;
  void sum_projections(const Job& job, std::uint32_t chunk, ResidualJob& steps) const;

  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  const tiller_hooks_t* hooks_ = nullptr;
  const TransitionRing* ring_ = nullptr;
  const Evidence* evidence_ = nullptr;
  std::uint32_t nx_ = 0, lanes_ = 0, steps_of_one_ = 1;
  float* residual_ = nullptr;  // (chunks x (predecessor, then a block) * nx * kChunk)
  std::uint64_t work_ = 0;
};

}  // namespace tiller
