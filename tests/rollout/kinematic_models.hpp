#pragma once

#include "rollout/rollout.hpp"

namespace tiller::test {

/// examples/unicycle: no forces, no joints.
const tiller_model_t* unicycle();
/// A double integrator of which everything is known: no parameters either, and no angle.
const tiller_model_t* known_integrator();

/// A joint, and states that are none and follow from its velocity.
const tiller_model_t* heavy_unicycle();

}  // namespace tiller::test
