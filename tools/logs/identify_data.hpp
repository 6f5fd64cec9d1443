#pragma once

#include <string>
#include <vector>

#include "posterior/posterior.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::tools {

/// A stretch of a log without gaps, as the posterior takes it: merged to about the robot's period, each transition
/// with its measured length and the mean input over it.
struct Stretch {
  std::string path;
  double first_time_s = 0;
  double start[TILLER_MAX_MEASUREMENTS] = {};  // (ny)
  std::vector<Transition> steps;
};

/// Merges rows to steps of about config.period_s (a log that is coarser keeps its own steps) and splits at gaps.
std::vector<Stretch> make_stretches(const Log& log, const LogMap& map, const tiller_config_t& config);

/// A sensor of [[log.sensors]] on a grid.
struct GridSensor {
  LogSensor is;
  std::vector<double> value;  ///< (points); NaN where not measured
};

/// A stretch on a uniform grid of config.period_s, for rollouts that many lanes take together.
struct Grid {
  std::string path;
  double first_time_s = 0;
  double period_s = 0;
  double time_scale = 1;  ///< of what is slow and fast here, over that of a machine that moves within a second
  std::vector<std::vector<double>> state;  ///< (nx) of (points): interpolated; NaN where not measured
  std::vector<std::vector<double>> input;  ///< (nu) of (points): mean from the point to the next
  std::vector<GridSensor> sensor;
  double log_start_s = 0;  ///< first_time_s of its log
  double since_start_s(std::size_t point) const {
    return first_time_s - log_start_s + static_cast<double>(point) * period_s;
  }
  std::size_t points() const { return input.empty() ? 0 : input[0].size(); }
};
std::vector<Grid> make_grids(const Log& log, const LogMap& map, const tiller_config_t& config);
/// The points from `first` until before `end`.
Grid part_of(const Grid& grid, std::size_t first, std::size_t end);
/// Angles made continuous, as a copy: a log that wraps them would have jumps.
Grid unwrapped(const Grid& grid, const tiller_model_t& model);

/// A state at grid point `point` from the measurements around it alone, so that no candidate model has a hand in
/// it: per joint a parabola of position over time, fitted by least squares to the positions and to the measured
/// rates, weighted by the sensors' deviations, over +-half_width_s (at least two points to either side). States
/// that belong to no joint are averaged over three points. `sd` (nx, nullable): what the sensors' deviations leave of
/// doubt. A state that no sensor sees, and that is no speed of a measured position, is where [start] has it. False
/// where a needed value is missing.
bool estimate_state(const Grid& grid, const tiller_config_t& config, std::size_t point, double half_width_s,
                    double* state, double* sd = nullptr);

}  // namespace tiller::tools
