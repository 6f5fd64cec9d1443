#pragma once

// Tasks whose parameters are off, by up to 30 % where no other share is named, and their runs: what bench_uncertainty
// compares.

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "bench/planning/knowledge.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

/// One task with its settings, all of them; chosen on seeds 1001..1020.
struct UncertainTask {
  std::string name;
  tiller::Config config;           ///< priors: nominal values, all fixed
  std::vector<std::uint32_t> off;  ///< parameters that are uniform around their nominal value, +- off_share of it
  std::uint32_t ticks;
  double rail_m = 0.0;            ///< bound on |state 0| that a run is judged by; 0: none
  std::uint32_t hypotheses = 16;  ///< particles of expected-cost and CVaR planning
  double off_share = 0.3;
  bool noisy_plant = false;  ///< the plant has the configured process noise
  int upright_state = -1;  ///< state that a run is judged by: within 0.3 rad of the target in its last second; -1: none
};

/// Changes one setting, for choosing them; false: there is none of that name.
bool override_setting(UncertainTask& task, const std::string& key, double value);

UncertainTask cart_pole_task();
UncertainTask rail_task();
/// The rail as a constraint of `sqp`.
UncertainTask bounded_rail_task();
UncertainTask acrobot_task();
UncertainTask planar_quadrotor_task();
/// The same with `sqp`.
UncertainTask bounded_quadrotor_task();
/// A swing-up of 6 s with the horizon of `horizon` periods; masses and length are off by `off_share`.
UncertainTask swing_up_task(std::uint32_t horizon, double off_share);

struct UncertainRun {
  double cost = 0.0;      ///< sum over the ticks of the task's step cost (target, weights; no bounds) at the true state
  double farthest = 0.0;  ///< largest |state 0|
  int bad_ticks = 0;      ///< ticks whose status was a fault
  bool held = false;      ///< upright_state stayed near its target in the last second
  double tick_us = 0.0;   ///< mean time of a tick, of this machine at this load
};

/// What a run looks like after a tick: the controller, the tick's number, the true state that its measurement was of.
using Observer = std::function<void(const tiller_t*, std::uint32_t tick, const double* state)>;

/// A whole run: a controller through its C interface in lockstep with the model itself at the true parameters,
/// integrated in double by RK4 at ten steps a period, and noisy encoders. The seed draws truth and noise.
UncertainRun run_uncertain(const UncertainTask& task, Knowledge knowledge, std::uint64_t seed,
                           const Observer& observe = nullptr);

}  // namespace tiller::bench
