#pragma once

#include <cstdint>

#include "rollout/rollout.hpp"

namespace tiller {

/// How many of a belief's hypotheses a planner takes that has room for `most`. Weighted ones stand in pairs behind
/// their mean (posterior/sigma_points.hpp): no pair is cut in two.
inline std::uint32_t hypotheses_within(const Belief& belief, std::uint32_t most) {
  if (belief.count <= most) return belief.count;
  return belief.weight ? most - (most + 1) % 2 : most;
}

/// Weights of the first m hypotheses, times m: 1 each where the belief says nothing. Those that are left out leave
/// theirs to the first, the mean of all: mean and covariance along the axes that are kept stand.
template <class T>
void fill_relative_weights(const Belief& belief, std::uint32_t m, T* weight) {
  double rest = 1.0;
  for (std::uint32_t j = 1; belief.weight && j < m; ++j) rest -= static_cast<double>(belief.weight[j]);
  for (std::uint32_t j = 0; j < m; ++j) {
    const double own = !belief.weight ? 1.0 : m * (j > 0 ? static_cast<double>(belief.weight[j]) : rest);
    weight[j] = static_cast<T>(own > 0.0 ? own : 0.0);
  }
}

}  // namespace tiller
