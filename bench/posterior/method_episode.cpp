#include "bench/posterior/method_episode.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "bench/problems/planning_problem.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

tools::Grid grid_of(const AccuracyTask& task, const Episode& episode, std::uint32_t ticks) {
  tools::Grid grid;
  grid.path = task.name;
  grid.period_s = task.config.period_s;
  grid.state.resize(episode.nx);
  grid.input.resize(episode.nu);
  for (std::uint32_t k = 0; k <= ticks; ++k) {
    for (std::uint32_t r = 0; r < episode.nx; ++r) grid.state[r].push_back(episode.state[k * episode.nx + r]);
    // the last point's input leads out of the episode: nobody reads it
    for (std::uint32_t i = 0; i < episode.nu; ++i)
      grid.input[i].push_back(episode.input[std::min(k, episode.ticks - 1) * episode.nu + i]);
  }
  return grid;
}

namespace {

tiller::Config planner_config(const AccuracyTask& pendulum, const std::vector<double>& truth,
                              const std::vector<double>& params, std::uint64_t seed) {
  tiller::Config c;
  if (tiller_config_default(&c, pendulum.config.model) != tiller_status_ok) std::abort();
  c.seed = seed;
  c.period_s = pendulum.config.period_s;
  c.integrator = pendulum.config.integrator;
  c.substeps = 1;
  c.body = pendulum.config.body;
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -INFINITY, INFINITY};
  const double level_Nm = truth[0] * 9.81 * truth[1], limit = 0.5 * level_Nm;
  c.safety.input_low[0] = -limit;
  c.safety.input_high[0] = limit;
  c.safety.input_rate_per_s[0] = INFINITY;
  c.planner.kind = tiller_planner_mppi;
  c.planner.horizon = 60;
  c.planner.knots = 8;
  c.planner.rollouts = 256;
  c.planner.particles = 1;
  c.planner.iterations = 2;
  c.planner.deadline_us = 0;
  c.planner.temperature = 0.02;
  c.planner.noise_sd[0] = 0.7 * limit;
  std::fill_n(c.cost.state_weight, TILLER_MAX_STATES, 0.0);
  c.cost.target[0] = 3.141592653589793;
  c.cost.state_weight[0] = 1.0;
  // the rate counts by what it is worth in height, whatever the length
  c.cost.state_weight[1] = 0.02 * truth[1];
  c.cost.input_weight[0] = 1e-3 / (limit * limit);
  return c;
}

}  // namespace

double swing_up_return(const AccuracyTask& pendulum, const std::vector<double>& truth,
                       const std::vector<double>& params, std::uint32_t ticks, std::uint64_t seed) {
  Planning planning(planner_config(pendulum, truth, params, seed));
  double x[TILLER_MAX_STATES] = {}, sum = 0;
  double next[TILLER_MAX_STATES * kLanePadding], lanes[TILLER_MAX_PARAMS * kLanePadding];
  for (std::size_t i = 0; i < truth.size(); ++i) std::fill_n(lanes + i * kLanePadding, kLanePadding, truth[i]);
  for (std::uint32_t k = 0; k < ticks; ++k) {
    planning.set_state(x);
    planning.plan();
    step_lanes(pendulum.config, planning.setup, kLanePadding, x, lanes, planning.command, next);
    for (std::uint32_t r = 0; r < pendulum.states(); ++r) x[r] = next[r * kLanePadding];
    sum += 0.5 * (1 - std::cos(x[0]));
  }
  return sum / ticks;
}

}  // namespace tiller::bench
