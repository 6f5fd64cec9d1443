#pragma once

#include <vector>

#include "core/rng.hpp"
#include "rollout/late_reading.hpp"
#include "tiller/config.hpp"
#include "tools/identify/identify_fit.hpp"
#include "tools/identify/lane_filter.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

/// A fitted candidate rolled out along logged inputs, 64 hypotheses at once: lane 0 is the posterior's mean, the others
/// are draws.
class Roller {
 public:
  static constexpr std::uint32_t kLanes = 64;
  Roller(const Candidate& candidate, const Fit& fit);

  /// Goes on to grid point `start`: each hypothesis' own Kalman filter has taken in the grid's measurements and inputs
  /// up to there, as on a robot that plans from there. A point before the last one begins the grid anew.
  void stand_at(const Grid& grid, std::size_t start);
  /// The prediction of each hypothesis from its state, without noise.
  void predict(std::size_t steps);
  /// The sensor readings of each hypothesis: a start of its own within its filter's doubt, process noise at
  /// every step and measurement noise on top, all as large as the fit found them.
  void read(std::size_t steps);

  const double* foreseen(std::size_t step, std::uint32_t state) const { return row(foreseen_.data(), step, state); }
  const double* readings(std::size_t step, std::uint32_t state) const { return row(readings_.data(), step, state); }

 private:
  /// States (steps x nx x lanes) become readings; a rate that is not measured follows its position's sensor.
  void as_measured(double* rows, std::size_t steps);
  /// Adds each lane's draw within its filter's doubt.
  void scatter(double* state);

  const double* row(const double* rows, std::size_t step, std::uint32_t state) const {
    return rows + (step * model_.state_count + state) * kLanes;
  }

  const Config config_;  // with the process noise that the fit found
  const tiller_model_t& model_;
  const RolloutTable& table_;
  GridRollout rollout_;
  LaneFilter filter_;
  const Grid* grid_ = nullptr;  // where the filters stand
  std::size_t point_ = 0;
  double noise_scale_;
  Rng rng_;
  double sensor_sd_[TILLER_MAX_STATES] = {};
  std::vector<double> effect_state_;  // (ns x lanes)
  std::vector<double> foreseen_;      // ((steps + 1) * nx x lanes)
  std::vector<double> readings_;      // ((steps + 1) * nx x lanes)
};

}  // namespace tiller::tools
