#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/logs/measured_rows.hpp"
#include "tools/robot/posterior_file.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::bench {

/// One run of a robot file against its simulated plant, in lockstep: what is varied.
struct EpisodeOptions {
  std::uint64_t seed = 1;  ///< of the plant's truth and noise, and of the controller
  tiller_planner_kind_t planner = tiller_planner_mppi;
  bool frozen = false;  ///< the posterior stays at the prior
  double seconds = 10.0;
  unsigned threads = 1;
  bool clock = false;         ///< give the controller a clock: the robot file's deadline holds
  bool cpu_clock = false;     ///< and it is this thread's CPU time, to which other programs add nothing (one thread)
  std::uint64_t episode = 0;  ///< of several with the same truth: noise and controller have seeds of their own
  /// Called after every tick, with its number and the true state (nx).
  std::function<void(std::uint64_t tick, const double* state)> watch;
};

/// Outcome for one parameter.
struct ParameterResult {
  std::string name;
  double truth, prior_sd, mean, sd, q05, q95;
  bool covered() const { return q05 <= truth && truth <= q95; }
  double shrink() const { return prior_sd / sd; }
};

struct EpisodeResult {
  std::uint64_t seed = 0;
  double upright_from_s = -1;  ///< since when |angle| < 0.2 rad has held without a break; -1: not at the end
  double cost = 0;             ///< mean stage cost of the true states
  double worst_position_m = 0;
  std::uint64_t command_hash = 0;  ///< of every bit of every command
  std::uint64_t ticks = 0, late_plans = 0, rejected = 0;
  double tick_us_median = 0, tick_us_p99 = 0, tick_us_p999 = 0, tick_us_worst = 0;  ///< 0 without a clock
  int state = 0, status = 0;
  double noise_scale = 0, effective_samples = 0, acceptance = 0;
  std::vector<ParameterResult> parameters;  ///< those with a prior
  tools::Particles particles;               ///< of the posterior at the end
  tools::MeasuredRows rows;                 ///< what was measured and commanded
  std::string error;                        ///< not empty: the episode could not run

  bool upright() const { return upright_from_s >= 0 && upright_from_s <= 6.0; }
};

EpisodeResult run_episode(const tools::RobotFile& robot, const EpisodeOptions& options);

}  // namespace tiller::bench
