#pragma once

#include "posterior/filter/filter_start.hpp"

namespace tiller {

/// A filter that looks out for contacts (safety.contact_force) and shoves, beside those that learn: a force may come
/// from one period to the next there, which a posterior that has long found the world still would first take for noise,
/// or put down to the parameters.
///
/// Its lanes have the parameters of as many particles, one of each kLanes-th of the weight, and these particles'
/// viscous and dry forces: what is left to the wandering ones is what nobody has learnt.
class SuddenForces {
 public:
  /// Null where no joint has a force that somebody asks for. The disturbances stand at `at` once there is memory.
  static SuddenForces* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                               const DisturbanceStates& disturbances, const DisturbanceStates* at, std::uint32_t d);

  void begin(const LaneFilter& filter, const FilterStart& start, const FilterParticles& particles);
  /// `seen` as it came: what the particles take for a glitch may be a blow. A value that this filter cannot explain
  /// either is one.
  void step(const LaneFilter& filter, const FilterParticles& particles, const Observation& seen,
            const NoiseScale& noise);
  /// Of step()'s readings, those that this filter explained: by how much it predicted them better than the particles,
  /// which have predicted them in `chunks`, under the noise as it was before a push put anything into it. A log ratio
  /// of likelihoods. Cost: N residuals a reading.
  double ahead_of(const LaneFilter& filter, const FilterChunk* chunks, const FilterParticles& particles,
                  const NoiseScale& noise) const;
  /// The lanes' filters, all of the same weight, and which of their states are sudden forces.
  const FilterChunk& lanes() const { return *chunk_; }
  bool is_sudden(std::uint32_t f) const;
  /// Means and deviations of the forces (joints) under this noise.
  void read(const LaneFilter& filter, double noise_scale, double* mean, double* sd) const;

 private:
  static constexpr std::uint32_t kLanes = FilterChunk::kLanes;

  void follow(const FilterParticles& particles) const;

  const FilterChunk* chunk_ = nullptr;
  double* readings_ = nullptr;  // (ny) of the last step; NaN: not explained, or missing
  double log_density_ = 0.0;    // of them, as they were predicted
};

}  // namespace tiller
