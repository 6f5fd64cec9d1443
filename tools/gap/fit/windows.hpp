#pragma once

#include <cstdint>
#include <vector>

#include "tools/gap/fit/gauges.hpp"

namespace tiller::tools::gap {

/// A stretch of a grid that is rolled out in one go: points start .. start + points - 1.
struct Window {
  std::uint32_t grid = 0;
  std::uint32_t points = 0;
  std::size_t start = 0;
  std::uint32_t fold = 0;                 ///< 0 or 1: fitted with one half of the windows, decided on the other
  bool test = false;                      ///< kept from fit and decision alike
  double x0[TILLER_MAX_STATES] = {};      ///< of the measurements alone
  double x0_sd[TILLER_MAX_STATES] = {};   ///< what the sensors' deviations leave of doubt
  double run_in[TILLER_MAX_STATES] = {};  ///< the same at the run-in's first point
  std::uint32_t run_in_steps = 0;         ///< commands that states of effects see before the window
};

/// The data that windows are cut from, as rollouts read them. Angles are unwrapped.
struct WindowData {
  std::vector<Grid> grids;
  std::vector<std::vector<double>> controls;  ///< per grid (points x nu)
  std::vector<std::vector<double>> measured;  ///< per grid (points x ny)
  Gauges gauges;                              ///< the logs' further sensors
  std::vector<std::vector<double>> gauged;    ///< per grid (points x gauges)
  /// Per grid (points x nx): the state at each point as the measurements around it say; NaN where they do not.
  std::vector<std::vector<double>> path;
  std::vector<bool> begins_at_rest;                  ///< per grid: it is a log's beginning, and nothing moves there
  std::vector<std::vector<double>> commands_before;  ///< per grid (nu): in force before its first point
  double data_s = 0;
};

/// Copies and unwraps the grids.
WindowData make_window_data(std::vector<Grid> grids, const tiller_config_t& config);

/// Gives a window its start state and its run-in by its grid and start; false where the measurements do not tell them.
/// A log that begins at rest needs no run-in at its first point: drives are at commands_before.
bool begin_window(const WindowData& data, const tiller_config_t& config, Window& window);

/// Windows of about `seconds` times the grids' time scale, end to end, each with a run-in before it; in a log that
/// begins at rest from its first point. Stretches that are too short give none. `first_grid`, `last_grid`: of
/// data.grids.
std::vector<Window> make_windows(const WindowData& data, const tiller_config_t& config, double seconds,
                                 std::size_t first_grid, std::size_t last_grid);

/// Marks about `share` of the windows as test, in runs of three neighbours so that long rollouts fit into them; the
/// others get their folds in turn. Deterministic.
void split_windows(std::vector<Window>& windows, double share);

}  // namespace tiller::tools::gap
