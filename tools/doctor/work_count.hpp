#pragma once

#include <cstdint>
#include <string>

#include "tiller/tiller.h"

namespace tiller::tools {

/// How often a controller steps its model, by the kernel that does it. A step is one integrator step of one lane.
struct ModelWork {
  std::uint64_t rollout_f32 = 0;     ///< planning by samples
  std::uint64_t rollout_f64 = 0;     ///< predictions of the posterior and of the host
  std::uint64_t linearise = 0;       ///< with derivatives: extended Kalman filters
  std::uint64_t residual = 0;        ///< one-step residuals of the transition engine
  std::uint64_t path_linearise = 0;  ///< with derivatives along a plan: gradient planners
  std::uint64_t path_feedback = 0;   ///< candidates of their line search
  std::uint64_t steps() const;
  /// As many instructions as these steps take on a Cortex-M7 (tools/doctor/instruction_costs.def); models that are not
  /// listed count as the listed one with the next number of states, named in `stand_in`.
  double instructions(const tiller_config_t& config, std::string& stand_in) const;
};

/// Instructions of a tick over those of its model steps: the filters' algebra, sampling, weights. Measured on the image
/// of tests/cortex_m: see docs/guide/targets.md.
constexpr double kBesideSteps = 1.2;

/// The work of ticks, counted, not derived: a controller of this configuration runs `ticks` ticks on its own model at
/// the priors' centre, in motion, and its kernels count. `most` is the largest tick's, field by field. False with the
/// reason in `error`. Not thread-safe: the kernels have no context to count in.
bool count_work(const tiller_config_t& config, std::uint32_t ticks, ModelWork& mean, ModelWork& most,
                std::string& error);

/// Wall time of a tick on this computer, one thread: the median of up to `window` + 42 ticks on the configuration's own
/// model, or of those that begin within `budget_s`, at least one after a cold one. Of them the later half counts.
struct TickTime {
  double tick_s = 0.0;
  std::uint64_t steps = 0;       ///< of the model
  double step_s = 0.0;           ///< mean of one of them
  std::uint32_t iterations = 0;  ///< of the planner
  double beside_s() const { return tick_s - step_s * static_cast<double>(steps); }
};

/// `by_clock`: the planner's deadline ends a plan, as on a robot; else the cap of iterations. False with the reason in
/// `error`. Not thread-safe, as count_work.
bool time_ticks(const tiller_config_t& config, double budget_s, bool by_clock, TickTime& time, std::string& error);

}  // namespace tiller::tools
