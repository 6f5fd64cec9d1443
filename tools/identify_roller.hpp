#pragma once

#include <vector>

#include "core/rng.hpp"
#include "rollout/measurement.hpp"
#include "tools/grid_rollout.hpp"
#include "tools/identify_data.hpp"
#include "tools/identify_fit.hpp"

namespace tiller::tools {

/// A fitted candidate rolled out along logged inputs, 64 hypotheses at once: lane 0 is the posterior's mean, the others
/// are draws.
class Roller {
 public:
  static constexpr std::uint32_t kLanes = 64;
  /// `candidate` outlives the roller.
  Roller(const Candidate& candidate, const Fit& fit);

  /// What each hypothesis foresees from `state` (nx) at grid point `start`: no noise.
  void foresee(const Grid& grid, std::size_t start, std::size_t steps, const double* state);
  /// What the sensors of each hypothesis would read: a start of its own (`state` with deviations `sd`), process noise
  /// at every step and measurement noise on top, both as large as the fit found them.
  void read(const Grid& grid, std::size_t start, std::size_t steps, const double* state, const double* sd);

  const double* foreseen(std::size_t step, std::uint32_t state) const { return row(foreseen_.data(), step, state); }
  const double* readings(std::size_t step, std::uint32_t state) const { return row(readings_.data(), step, state); }

 private:
  /// What the sensors make of a state in each lane; a rate that is not measured follows its position's sensor.
  void map_sensors();
  /// `state` as measured -> (nx x lanes) states, and trajectories back to what is measured. Nothing without sensor
  /// effects.
  void start_from(const double* state);
  void as_measured(double* rows, std::size_t count) const;

  const double* row(const double* rows, std::size_t step, std::uint32_t state) const {
    return rows + (step * model_.state_count + state) * kLanes;
  }

  const tiller_config_t& config_;
  const tiller_model_t& model_;
  const RolloutTable& table_;
  GridRollout rollout_;
  double noise_scale_;
  Rng rng_;
  double sensor_sd_[TILLER_MAX_STATES] = {};
  std::vector<double> effect_state_;  // (ns x lanes)
  std::vector<MeasurementMap> maps_;  // (nx x lanes)
  std::vector<double> start_;         // (nx x lanes)
  std::vector<double> foreseen_;      // ((steps + 1) * nx x lanes)
  std::vector<double> readings_;      // ((steps + 1) * nx x lanes)
};

}  // namespace tiller::tools
