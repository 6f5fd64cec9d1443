#include "tools/identify/episodes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tiller::tools {
namespace {

constexpr double kHalfWidth_s = 0.03;  // of the data that a state is estimated from, as in identify_score.hpp

Episode make_episode(const Grid& grid, const tiller_config_t& config, bool measured) {
  Episode episode;
  episode.grid = &grid;
  episode.nx = config.model->state_count;
  episode.state.assign(grid.points() * episode.nx, std::numeric_limits<double>::quiet_NaN());
  episode.sd.assign(episode.state.size(), 0.0);
  for (std::size_t p = 0; p < grid.points(); ++p) {
    double *state = episode.state.data() + p * episode.nx, *sd = episode.sd.data() + p * episode.nx;
    double estimate[TILLER_MAX_STATES], doubt[TILLER_MAX_STATES];
    if (measured) {
      for (std::uint32_t i = 0; i < episode.nx; ++i) state[i] = grid.state[i][p];
      for (std::uint32_t k = 0; k < config.measurement_count; ++k)
        sd[config.measured_state[k]] = config.measurement_sd[k];
    } else if (estimate_state(grid, config, p, kHalfWidth_s, estimate, doubt)) {
      std::copy_n(estimate, episode.nx, state);
      std::copy_n(doubt, episode.nx, sd);
    }
  }
  return episode;
}

}  // namespace

bool Episode::known(std::size_t point) const {
  for (std::uint32_t i = 0; i < nx; ++i)
    if (!std::isfinite(at(point)[i])) return false;
  return true;
}

bool every_state_measured(const tiller_config_t& config) {
  std::uint64_t seen = 0;  // of as many as 32 states, which a word of 32 bits cannot count up to
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) seen |= std::uint64_t{1} << config.measured_state[k];
  return seen == (std::uint64_t{1} << config.model->state_count) - 1;
}

bool make_episodes(const MethodProblem& problem, std::vector<Episode>& episodes, std::string& error) {
  const bool measured = every_state_measured(*problem.config);
  for (const Grid& grid : *problem.grids) episodes.push_back(make_episode(grid, *problem.config, measured));
  for (const Episode& episode : episodes)
    for (std::size_t p = 0; p + 1 < episode.points(); ++p)
      if (episode.known(p) && episode.known(p + 1)) return true;
  error = episodes.empty() ? std::string("the logs hold no stretch of at least five rows without a gap")
                           : "the logs hold no two points in a row at which every state is known; a joint needs its "
                             "position or its rate at five points in a row, every other state a column of its own";
  return false;
}

std::vector<RolloutSpan> make_spans(const std::vector<Episode>& episodes, std::size_t steps) {
  std::vector<RolloutSpan> all, long_enough;
  for (const Episode& episode : episodes) {
    std::size_t p = 0;
    while (p + 1 < episode.points()) {
      if (!episode.known(p)) {
        ++p;
        continue;
      }
      const std::size_t left = episode.points() - 1 - p, length = steps == 0 ? left : std::min(steps, left);
      all.push_back({&episode, p, length});
      if (2 * length >= steps) long_enough.push_back(all.back());
      p += length;
    }
  }
  return long_enough.empty() ? all : long_enough;
}

}  // namespace tiller::tools
