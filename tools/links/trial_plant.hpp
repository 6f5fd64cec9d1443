#pragma once

#include <cstdint>
#include <vector>

#include "rollout/rollout.hpp"
#include "tools/links/plant_path.hpp"

namespace tiller::tools {

/// The value in the middle of what a prior expects: the centre of a uniform one, else its mean or median.
double centre_of(const tiller_prior_t& prior);

/// A configuration's model as the plant of a short trial: one lane from the start state, at the priors' centre, without
/// noise. It tries what a controller costs and where it goes, never whether the model is right.
class TrialPlant {
 public:
  TrialPlant(const tiller_config_t& config, std::uint32_t substeps);

  bool good() const { return good_; }
  void step(const double* command);                                          ///< one period under a held command (nu)
  const std::vector<double>& state() const { return state_; }                // (nx)
  const std::vector<double>& effect_state() const { return effect_state_; }  // (ns), at least one number
  const std::vector<double>& history() const { return history_; }            // (delay_steps + 1, nu), newest first
  /// The present readings of the sensors, its stamp `tick` periods after a second.
  tiller_measurement_t measure(std::uint32_t tick) const;

 private:
  const tiller_config_t& config_;
  bool good_ = false;
  StepSetup setup_;
  std::vector<double> params_, state_, effect_state_, history_;
  PlantPath path_;
};

}  // namespace tiller::tools
