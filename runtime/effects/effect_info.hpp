#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Where an effect attaches.
enum class PortKind { joint, input };

/// How the kernel calls an effect; see rollout/step.hpp for the order within a step.
enum class Hook {
  period_input,  ///< input = apply_period(history of inputs, parameters): once a period, before anything else
  input,         ///< input = apply(input, state, parameters, dt): once a substep, advances the effect's own state
  force,         ///< generalised force = force(q, v, parameters): enters the dynamics as it stands
  dissipation    ///< generalised force after the free step, implicit: force(v, v_free, dt/m, parameters)
};

struct EffectInfo {
  const char* name;
  PortKind port;
  int param_count;
  const char* param_names[4];
  const char* param_units[4];  ///< by the port: "_SI" names are N s/m or N m s/rad and the like
  double param_low[4];         ///< hard lower bound; -infinity for none
  int state_count;
  const char* help;
};

/// Metadata of a kind (tiller_effect_kind_t); kind < effect_kind_count().
const EffectInfo& effect_info(std::uint32_t kind);
/// Kind by name; -1 if there is none.
int find_effect(const char* name);
std::uint32_t effect_kind_count();

}  // namespace tiller
