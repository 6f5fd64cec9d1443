// What the posterior's moves give way to, and how they come back.
#include "executive/moves_given.hpp"

#include <gtest/gtest.h>

namespace tiller {
namespace {

constexpr std::uint32_t kConfigured = 32;

TEST(MovesGiven, stay_whole_while_every_plan_has_an_iteration) {
  MovesGiven given;
  given.reset(kConfigured);
  for (int k = 0; k < 1000; ++k) ASSERT_EQ(given.after_plan(false), kConfigured);
}

TEST(MovesGiven, are_halved_by_plans_without_one_and_come_back) {
  MovesGiven given;
  given.reset(kConfigured);
  EXPECT_EQ(given.after_plan(true), 16u);
  EXPECT_EQ(given.after_plan(true), 8u);
  for (int k = 0; k < 10; ++k) ASSERT_EQ(given.after_plan(true), 8u) << "with fewer, intervals would be too narrow";
  int plans = 0;
  while (given.after_plan(false) < kConfigured) ASSERT_LT(++plans, 3000);
  EXPECT_GT(plans, 100) << "an eighth at a time";
}

/// A tick that has time for a plan with 16 moves and no more: of the plans, ever fewer are late.
TEST(MovesGiven, settle_where_plans_are_made) {
  MovesGiven given;
  given.reset(kConfigured);
  std::uint32_t moves = kConfigured;
  int late = 0;
  constexpr int kPlans = 10000;
  for (int k = 0; k < kPlans; ++k) {
    late += moves > 16;
    moves = given.after_plan(moves > 16);
  }
  EXPECT_LE(late, 8) << "the waits double: 32, 64, .. add up to 10000 plans after 8 tries";
  EXPECT_GE(moves, 8u);
}

TEST(MovesGiven, of_none_are_none) {
  MovesGiven given;
  given.reset(0);
  for (int k = 0; k < 100; ++k) ASSERT_EQ(given.after_plan(k % 3 == 0), 0u);
}

}  // namespace
}  // namespace tiller
