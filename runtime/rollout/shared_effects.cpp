// The called effects, compiled once for each instruction set.

#define TILLER_DEFINES_SHARED_EFFECTS
#include "rollout/shared_effects.hpp"

namespace tiller {

TILLER_SHARED_EFFECTS_OF_ALL()

}  // namespace tiller
