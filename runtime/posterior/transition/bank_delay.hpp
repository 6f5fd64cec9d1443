#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// How a bank's delay hypotheses 0 .. D-1 periods become members.
///
/// Between whole periods: member j stands for delays of [j, j + 1) periods, j = 0 .. D-2. It is fed the inputs of j
/// periods ago and has one more parameter, the fraction in seconds, uniform on [0, period]: the delay of an
/// input_delay effect at every input, all of which share it. The residual's kinks in the delay, where a command of
/// one more period ago begins to act, lie at whole periods and so between members, never within one.
///
/// Whole periods, as many members as hypotheses, remain where the fraction has no place: the configuration has an
/// input_delay of its own, its effects or parameters leave no room for one more, or the posterior is frozen and would
/// learn no fraction.
struct DelayHypotheses {
  std::uint32_t members = 1;
  bool fractional = false;

  static DelayHypotheses of(const tiller_config_t& config, const StepSetup& setup);
  /// Parameters of a member: the configuration's, then the fraction.
  std::uint32_t param_count(const tiller_config_t& config) const { return config.param_count + (fractional ? 1u : 0u); }
  /// Makes the robot's configuration a member's: one more prior, and lay_out_delayed_mixture()'s joint one. `priors`
  /// (param_count()) is filled with all of them. Its effects stay the robot's; those that read the fraction are in
  /// member_setup() alone.
  void add_fraction(tiller_config_t& config, tiller_prior_t* priors, const tiller_mixture_t* prior_mixture) const;
  /// `config` and `setup` are the robot's.
  StepSetup member_setup(const tiller_config_t& config, const StepSetup& setup) const;
};

/// The joint prior of a member with a fraction: config.prior_mixture times the fraction's. Null where the configuration
/// has none, or while the arena measures.
const tiller_mixture_t* lay_out_delayed_mixture(Arena& arena, const tiller_config_t& config);

}  // namespace tiller
