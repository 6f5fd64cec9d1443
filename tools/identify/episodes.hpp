#pragma once

#include <string>
#include <vector>

#include "tools/identify/method.hpp"

namespace tiller::tools {

/// A grid with the state known at its points: as it was measured where every state has a sensor; else estimated from
/// the measurements around each point (estimate_state), so that no candidate has a hand in it.
struct Episode {
  const Grid* grid = nullptr;
  std::uint32_t nx = 0;
  std::vector<double> state;  ///< (points x nx); NaN: not known
  std::vector<double> sd;     ///< (points x nx) what the sensors' noise leaves of doubt in it
  std::size_t points() const { return grid->points(); }
  const double* at(std::size_t point) const { return state.data() + point * nx; }
  const double* sd_at(std::size_t point) const { return sd.data() + point * nx; }
  bool known(std::size_t point) const;
};

/// True if each state has a sensor of its own.
bool every_state_measured(const tiller_config_t& config);

/// False with a sentence in `error` where the grids hold no two known states in a row.
bool make_episodes(const MethodProblem& problem, std::vector<Episode>& episodes, std::string& error);

/// Where a rollout begins, and how many periods the logs can follow it.
struct RolloutSpan {
  const Episode* episode;
  std::size_t start, steps;
};

/// Cuts the episodes into rollouts of `steps` periods, one after the other (0: as long as the episode lasts). A span
/// begins at a known state and ends at the next one's beginning; what is shorter than half of `steps` is left out
/// unless nothing else is there.
std::vector<RolloutSpan> make_spans(const std::vector<Episode>& episodes, std::size_t steps);

}  // namespace tiller::tools
