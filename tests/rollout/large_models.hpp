#pragma once

#include "rollout/rollout.hpp"

namespace tiller::test {

/// The program's model of many states, compiled as a kernel.
const tiller_model_t* large_model();
/// The same equations as a table in C, which shares neither lanes nor derivatives with it.
const tiller_model_t* large_model_in_c();

}  // namespace tiller::test
