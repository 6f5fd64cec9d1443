#pragma once

#include <cstdint>

#include "posterior/filter/jump_bank.hpp"
#include "posterior/filter/particles.hpp"
#include "posterior/posterior.hpp"

namespace tiller {

/// Rows of parameters that only a sensor's map reads: the filter's states do not say how it reads.
std::uint64_t sensor_rows(const tiller_config_t& config);

/// Banks of filters beside those that learn, one for each parameter that may drift: whether it jumped, walks or stays.
///
/// A drift that is estimated follows whatever a parameter does, and its rate does not say which of these it was. In a
/// bank every lane has a course of the drifting parameter (JumpBank), and all parameters that are learnt as states; the
/// lanes' likelihoods, the noise's scale integrated out, are compared. A bank begins once the posterior has taken its
/// first data in, with what it knows then: linear in the parameters, it would not do with what the prior leaves open.
class JumpBanks {
 public:
  /// Null where no parameter drifts.
  static JumpBanks* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                            const RolloutTable& table, const DisturbanceStates& disturbances, std::uint32_t d);

  /// The filters have started again, and no lane knows where: nothing is reported until the banks begin again.
  void stop() { begun_ = false; }
  /// After a tick that leaves the cloud settled: begins the banks if they have not begun, and takes the means of what
  /// they do not test.
  void follow(const FilterParticles& particles, double noise_scale);
  /// A transition, as the particles take it.
  void step(const LaneFilter& filter, const Observation& seen, double elapsed_s, double noise_scale);
  void report(double elapsed_s, double noise_scale, PosteriorReport& report) const;

 private:
  static constexpr std::uint32_t kLanes = FilterChunk::kLanes;

  void begin(const FilterParticles& particles, double noise_scale);
  void begin_lanes(const FilterChunk& chunk, const FilterParticles& particles, double noise_scale) const;
  void differ(const FilterParticles& particles, std::uint32_t i, std::uint32_t about, double* off) const;
  std::uint32_t carried_row(const FilterParticles& particles, std::uint32_t state) const;
  void take_mean_law(std::uint32_t drift, const FilterParticles& particles);
  void weigh(std::uint32_t drift, double* log_likelihood) const;
  void open_jump(std::uint32_t drift, std::uint32_t effect_states, double elapsed_s, double noise_scale);
  void report_last(std::uint32_t drift, std::uint32_t lane, double elapsed_s, double noise_scale,
                   PosteriorReport& report) const;

  std::uint32_t forces() const { return states_.sources() - states_.drifts(); }  // sources that are no parameter's
  std::uint32_t first_param() const { return nx_ + states_.states() - states_.drifts(); }
  /// Of the parameter that a bank asks after.
  std::uint32_t state_of(std::uint32_t drift) const {
    return nx_ + states_.drift_state(states_.drift_of(param_[drift]));
  }
  double& variance(std::uint32_t drift, std::uint32_t lane) const;
  double drift_at(std::uint32_t drift, std::uint32_t lane) const;

  const tiller_config_t* config_ = nullptr;
  std::uint32_t nx_ = 0, drifts_ = 0;
  std::uint32_t param_[TILLER_MAX_DRIFTS] = {};  // of each bank
  DisturbanceStates states_;                     // of the banks' filters
  ScaleEvidence evidence_;
  const FilterChunk* chunks_ = nullptr;  // (drifts)
  JumpBank* banks_ = nullptr;            // (drifts)
  bool begun_ = false;
};

}  // namespace tiller
