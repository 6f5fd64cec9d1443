#pragma once

#include <cstdint>

#include "posterior/cloud.hpp"
#include "posterior/filter/lane_filter.hpp"
#include "posterior/filter/scale_evidence.hpp"

namespace tiller {

/// Whether the ratio of process to sensor noise is inferred: where there is process noise whose size may be misstated.
bool infers_noise_ratio(const tiller_config_t& config);

/// The cloud, and what each particle carries beside its parameters: a filter, its noise and its disturbances' laws, and
/// the sums over all data. Rows of N.
struct FilterParticles {
  static constexpr std::uint32_t kRows = ScaleEvidence::kRows;

  Cloud cloud;
  FilterRows filter;
  const DisturbanceStates* disturbances = nullptr;
  bool has_ratio = false;
  std::uint32_t nf = 0, ns = 0;      // states of the filters, those of the disturbances included; of the effects
  double* process_scale = nullptr;   // (N) factor of the process noise's variance
  double* laws = nullptr;            // (law_rows x N) of what the model lacks; null where nothing is looked for
  double* present = nullptr;         // (np x N) parameters as they have drifted; null where none does
  double* sums = nullptr;            // (kRows x N) over all data
  double* base = nullptr;            // (kRows x N) what came before the window's start (exact windows only)
  double* recent = nullptr;          // (kRows x N) of the sums, what is under suspicion; null where no force may come
  double* log_likelihood = nullptr;  // (N) of all data
  double* scratch = nullptr;         // (kRows + 2 x N)
  NormalLaw before;                  // what was known before the robot changed

  /// The disturbances stand at `at` once there is memory.
  static FilterParticles lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                 const DisturbanceStates& disturbances, const DisturbanceStates* at);

  void draw_prior();
  void clear_sums();
  /// Of all sums only this share is kept.
  void forget(double keep);
  /// What the particles carry follows Cloud::resample().
  void permute();
  /// The posterior becomes half of a new prior, from which every other particle is drawn, with the noise's coordinates
  /// that it had. `change` counts these events.
  void draw_again(std::uint64_t tick, std::uint64_t change);
  /// The parameters as each filter has them, after its last step.
  void note_drift();

  std::uint32_t n() const { return cloud.n; }
  std::uint32_t chunks() const { return cloud.n / FilterChunk::kLanes; }
  double weight(std::uint32_t i) const { return cloud.weight[i]; }
  double* state(std::uint32_t r) const { return filter.state + std::size_t{r} * cloud.n; }
  double* covariance(std::uint32_t r, std::uint32_t c) const {  // r <= c
    return filter.covariance + std::size_t{triangle_row(nf, r, c)} * cloud.n;
  }
  double* effect_state(std::uint32_t r) const { return filter.effect_state + std::size_t{r} * cloud.n; }
  double* law(std::uint32_t row) const { return laws + std::size_t{row} * cloud.n; }
  double* scratch_row(std::uint32_t row) const { return scratch + std::size_t{row} * cloud.n; }
  const double* params_now() const { return present ? present : cloud.params; }
  double mean(const double* row) const;
  std::uint32_t heaviest() const;
  /// How a particle's filter differs from another's (nf), attitudes by their differences.
  void differ(std::uint32_t i, std::uint32_t about, double* off) const;

  /// The particles of chunk c.
  FilterRows lanes(std::uint32_t c) const;
  const double* params_of(std::uint32_t c) const { return cloud.params + c * FilterChunk::kLanes; }
  Lanes<double> laws_of(std::uint32_t c) const;
  LaneStep step(std::uint32_t c) const {
    return {lanes(c), {params_of(c), cloud.n}, process_scale + c * FilterChunk::kLanes, laws_of(c)};
  }
  /// Coordinates (d) become a lane's parameters, noise and laws.
  void place(const FilterChunk& chunk, std::uint32_t lane, const double* coordinate) const;
  /// A particle goes where the lane is, with its filter. The caller sets the sums.
  void take_over(std::uint32_t i, const FilterChunk& chunk, std::uint32_t lane, const double* coordinate);

 private:
  /// What the engine's own coordinates of one particle say.
  void read_own(const double* coordinate, std::uint32_t stride, double* process_scale, double* law,
                std::uint32_t law_stride) const;
};

}  // namespace tiller
