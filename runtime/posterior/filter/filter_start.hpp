#pragma once

#include <cstdint>

#include "posterior/filter/lane_filter.hpp"
#include "posterior/filter/particles.hpp"

namespace tiller {

class SuddenForces;

/// Where the filters of an exact window begin, the same for every particle: at the configured state, or, in mid-run,
/// wherever the robot may have got to. A first measurement corrects it.
class FilterStart {
 public:
  static FilterStart lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t states,
                             std::uint32_t effect_states);

  /// At the configured state.
  void reset(const tiller_config_t& config);
  /// After a pause a state may be as far from where it began as it has ever been: believing it closer, the first values
  /// would speak of noise where they only speak of the pause. measured: (ny).
  void begin_after_pause(const tiller_config_t& config, const double* measured);
  /// Every filter goes on from where they are together: mean, mean covariance and what they disagree about.
  void begin_at_present(const LaneFilter& filter, const FilterParticles& particles);
  /// The same, with states and sudden forces as the filter has them that looks out for these.
  void begin_pushed(const LaneFilter& filter, const FilterParticles& particles, const SuddenForces& sudden);
  /// Afterwards: the heaviest particle's state has been there.
  void note_reach(const tiller_config_t& config, const FilterParticles& particles);

  /// The start's law into the filters of `rows`, corrected by its measurement, which does not count into the likelihood
  /// (of no parameter but a sensor's, and of these the others tell more).
  void begin_filters(const LaneFilter& filter, const FilterChunk& chunk, const FilterRows& rows, Lanes<double> params,
                     Lanes<double> law) const;
  void begin_all(const LaneFilter& filter, const FilterChunk* chunks, FilterParticles& particles) const;
  /// How large a force has to be to matter, from what forces do to the first chunk's particles there.
  void measure_forces(const LaneFilter& filter, const FilterChunk& chunk, const FilterParticles& particles,
                      const double* history, DisturbanceStates& disturbances) const;

  /// Of the friction's size, where all filters began with the same; else null: they have their particle's.
  const double* friction_law() const { return has_forces_ ? friction_law_ : nullptr; }  // (joints)

 private:
  struct Mixture {
    FilterRows rows;
    std::uint32_t count, about;  // about: the one from which attitudes are counted
    const double* weight;        // (count)
  };
  void take_mixture(const LaneFilter& filter, const Mixture& mixture);
  void set(const tiller_config_t& config, const double* sd);
  void clear();

  std::uint32_t nx_ = 0, nf_ = 0, ns_ = 0, ny_ = 0;
  double* state_ = nullptr;               // (nf)
  double* covariance_ = nullptr;          // (triangle)
  double* effect_state_ = nullptr;        // (ns)
  double* measured_ = nullptr;            // (ny)
  bool has_forces_ = true;                // the law says what the model lacks
  double reach_[TILLER_MAX_STATES] = {};  // farthest that a state has been from where it began
  double friction_law_[kDiscrepancyJoints] = {};
};

}  // namespace tiller
