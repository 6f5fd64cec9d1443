#pragma once

#include <atomic>
#include <cstdint>

#include "rollout/rollout.hpp"

namespace tiller_test {

/// A rollout written as plainly as can be, apart from the library's kernels: explicit Euler in double, one lane after
/// the other, quadratic cost of each state reached from (terminal weight on the last) and of each input. No effects.
const tiller::RolloutTable& plain_rollout();

/// Called at the start of every plain rollout if set: a test's clock ticks here.
extern void (*on_plain_rollout)();

}  // namespace tiller_test
