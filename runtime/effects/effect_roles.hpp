#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// What an effect is to planners, fits and reports, from its line in effects.def. Code that treats some effects apart
/// asks for a role, so that a new effect is treated right by its line alone. A memory is EffectInfo::state_count > 0.
enum EffectRole : std::uint32_t {
  kNoRole = 0,
  kDelay = 1u << 0,    ///< parameter 0 is a time; the command of that time ago acts
  kLag = 1u << 1,      ///< parameter 0 is the time constant of a first-order lag; 0 passes the command
  kLimit = 1u << 2,    ///< parameter 0 bounds the command or its rate; 0 is off, and the larger, the less it does
  kFollows = 1u << 3,  ///< the state is a value that follows the command
  kLoad = 1u << 4,     ///< the state is the mean of |command| over the time of parameter 1
  kLinear = 1u << 5,   ///< a force that is linear in the state, without memory
  kWidth = 1u << 6,    ///< the parameters are widths; of no width it does nothing
  kClock = 1u << 7,    ///< the state is the time since the start of the run, or of its log
  kSmooth = 1u << 8,   ///< has a derivative at rest and no memory: part of a linear model of the robot there
  kLate = 1u << 9      ///< at a sensor, parameter 0 is a time; the state of that time ago is read
};

constexpr std::uint32_t kEffectRoles[] = {
#define TILLER_EFFECT(name, Type, roles, like) roles,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};

/// Whether the kind (tiller_effect_kind_t) has any of the roles.
constexpr bool has_role(std::uint32_t kind, std::uint32_t roles) {
  return kind < tiller_effect_kind_count && (kEffectRoles[kind] & roles) != 0;
}

/// Whether the table says that one of the two kinds is like the other.
bool are_alike(std::uint32_t a, std::uint32_t b);

}  // namespace tiller
