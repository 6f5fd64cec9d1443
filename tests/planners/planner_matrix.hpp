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

/// Draws only for the scout that leaves a local minimum: where the plan makes progress, commands are those of any seed.
inline bool draws_where_stuck(std::uint32_t planner) {
  return planner == tiller_planner_ilqr || planner == tiller_planner_sqp;
}

#define TILLER_EVERY_PLANNER(suite)                                                                                  \
  INSTANTIATE_TEST_SUITE_P(planners, suite, ::testing::Range(0u, static_cast<std::uint32_t>(tiller_planner_policy)), \
                           [](const auto& p) { return tiller::find_planner(p.param)->name; })

}  // namespace tiller_test
