#pragma once

#include <cstdint>
#include <vector>

#include "posterior/filter_lanes.hpp"
#include "posterior/posterior.hpp"
#include "rollout/rollout.hpp"

namespace tiller::tools {

/// Extended Kalman filters side by side over the same data, each lane with parameters and process noise of its own:
/// what the posterior's particles carry, for parameters that stay. Variances are over the common noise scale's square.
class LaneFilter {
 public:
  /// `lanes`: a multiple of kLanePadding. The configuration outlives the filter and has passed tiller_config_check.
  LaneFilter(const tiller_config_t& config, std::uint32_t lanes);

  std::uint32_t lanes() const { return lanes_; }
  double* params() { return params_.data(); }                   // (np x lanes) to be filled before begin()
  double* process_variance() { return process_share_.data(); }  // (lanes) factors of process_sd^2; 1 at first

  /// The configured start state, corrected by the first measurement (ny), NaN: missing.
  void begin(const double* measured);
  /// Takes in one transition. A value beyond eight deviations in every lane, `noise_scale` times the configured ones,
  /// counts as missing, up to five in a row.
  void step(const Transition& transition, double noise_scale);

  const double* state() const { return state_.data(); }                // (nx x lanes)
  const double* effect_state() const { return effect_state_.data(); }  // (ns x lanes)
  /// Lower Cholesky factor of one lane's covariance, (nx x nx) row-major.
  void root(std::uint32_t lane, double* root) const;
  double squared_error(std::uint32_t lane) const { return squared_error_[lane]; }  ///< sum of e^2 / s since begin()
  double log_variance(std::uint32_t lane) const { return log_variance_[lane]; }    ///< sum of log s
  std::uint64_t values() const { return values_; }                                 ///< measured values in these sums

 private:
  /// `before`: (nx x lanes) of a period ago; null where there is none.
  void map_sensors(const double* before, double period_s);
  void predict(const Transition& transition);
  void correct(const double* measured);
  void gate(double* measured, double noise_scale);
  bool is_explained(std::uint32_t channel, const double* measured, double noise_scale) const;

  const tiller_config_t& config_;
  const tiller_model_t& model_;
  const RolloutTable& table_;
  const FilterTable& filter_;
  StepSetup setup_;
  std::uint32_t lanes_, nx_, nu_, ny_, ns_;
  std::vector<double> params_, process_share_, state_, covariance_, effect_state_, jacobian_, history_;
  std::vector<double> next_state_, next_effect_state_;
  std::vector<double> gain_, offset_, rate_gain_, squared_error_, log_variance_;
  double measurement_variance_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint32_t rate_state_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint32_t gated_in_a_row_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint64_t values_ = 0;
};

}  // namespace tiller::tools
