#pragma once

#include <string>
#include <vector>

#include "tools/identify/identify_fit.hpp"

namespace tiller::tools {

/// Errors of rollouts that begin at many points of the logs and follow the logged inputs: how well a planner would
/// have foreseen the robot.
struct HorizonError {
  double horizon_s = 0;
  double rms_end = 0;      ///< of the error at the horizon's end
  double median_end = 0;   ///< of its absolute value: what one rollout near an upright cannot dominate
  double rms_along = 0;    ///< over the whole way there
  double coverage_90 = 0;  ///< share of ends inside the predictive 5-95 % (see RolloutTrace)
  std::size_t rollouts = 0;
};

/// One measured state that is a joint's position (every measured state where no position is measured).
struct StateScore {
  std::uint32_t state = 0;
  std::vector<HorizonError> horizons;
  std::vector<double> curve;  ///< RMS error after 1, 2, ... steps, of the starts that last the longest horizon
};

/// A rollout to look at: what was measured and what the posterior's mean foresees, between 5 % and 95 % of its draws
/// alone (low, high) and of what a sensor would read (predictive: draws, doubt of the start state, process and sensor
/// noise as estimated).
struct RolloutTrace {
  std::string path;
  std::uint32_t state = 0;
  double period_s = 0, start_s = 0;
  std::vector<double> measured, mean, low, high, predictive_low, predictive_high;
};

struct ScoreOptions {
  std::vector<double> horizons_s = {1.0, 2.0};
  double start_every_s = 0.05;
  double run_in_s = 0.3;     ///< of each log, before the first start: the filter finds what is not measured
  std::uint32_t traces = 4;  ///< kept, spread over the logs
};

struct Score {
  std::vector<StateScore> states;
  std::vector<RolloutTrace> traces;
  std::size_t diverged = 0;  ///< rollouts that were not finite
};

/// Rolls the candidate out from every start of the grids, at the posterior's mean, from what its own Kalman filter
/// makes of the log up to there; `fit` as fit() left it. A start counts for a horizon if the log lasts that long after
/// it.
Score score(const Candidate& candidate, const Fit& fit, const std::vector<Grid>& grids, const ScoreOptions& options);

}  // namespace tiller::tools
