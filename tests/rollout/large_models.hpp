#pragma once

#include "rollout/rollout.hpp"

namespace tiller::test {

/// Twelve states, compiled as a kernel.
const tiller_model_t* spatial_quadrotor();
/// The same equations as a table in C, which shares neither lanes nor derivatives with it.
const tiller_model_t* spatial_quadrotor_in_c();

}  // namespace tiller::test
