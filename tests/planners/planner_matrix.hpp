#pragma once

#include <gtest/gtest.h>

#include "problem.hpp"

namespace tiller_test {

/// A suite that runs on every line of planners.def that plans: what a policy promises is in policy_test.cpp.
class EveryPlanner : public ::testing::TestWithParam<std::uint32_t> {};

/// Solves along a linearisation: an iteration is two calls of the model's kernels, and where the model is linear the
/// plan is the optimum whatever was drawn.
inline bool is_gradient(std::uint32_t planner) {
  return planner == tiller_planner_ilqr || planner == tiller_planner_hybrid || planner == tiller_planner_sqp;
}

/// Its commands are those of any seed: SwingUp holds it to that, and one run stands for all seeds.
inline bool draws_nothing(std::uint32_t planner) {
  return planner == tiller_planner_ilqr || planner == tiller_planner_sqp;
}
inline std::vector<std::uint64_t> seeds_of(std::uint32_t planner, std::uint64_t count) {
  std::vector<std::uint64_t> seeds;
  for (std::uint64_t seed = 1; seed <= (draws_nothing(planner) ? 1 : count); ++seed) seeds.push_back(seed);
  return seeds;
}

#define TILLER_EVERY_PLANNER(suite)                                                                                  \
  INSTANTIATE_TEST_SUITE_P(planners, suite, ::testing::Range(0u, static_cast<std::uint32_t>(tiller_planner_policy)), \
                           [](const auto& p) { return tiller::find_planner(p.param)->name; })

}  // namespace tiller_test
