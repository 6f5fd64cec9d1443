// The loop that `tiller gap` is for, closed once per hidden effect: run, find, add, run again. Seeds are tuning seeds;
// `./dev bench gap loop` does twenty others and the statistics.

#include "harness/gap_loop/gap_loop.hpp"

#include <gtest/gtest.h>

namespace tiller::bench {
namespace {

class Loop : public testing::TestWithParam<HiddenEffect> {};
INSTANTIATE_TEST_SUITE_P(Hidden, Loop, testing::Values(HiddenEffect::dry_friction, HiddenEffect::delay),
                         [](const auto& tested) { return hidden_name(tested.param); });

TEST_P(Loop, TheNewFileTracksBetter) {
  LoopCase which;
  which.hidden = GetParam();
  which.seed = 100001;
  which.logs = 2;
  const LoopOutcome o = close_loop(which);
  ASSERT_FALSE(o.failed) << o.error;
  std::printf("%s %.3g: %s, rollouts %.2f -> %.2f sigma, cost %.4g -> %.4g\n", hidden_name(which.hidden), o.truth,
              o.named.c_str(), o.gap_before, o.gap_after, o.before, o.after);
  EXPECT_NE(o.named.find(hidden_name(which.hidden)), std::string::npos) << o.named;
  EXPECT_LT(o.gap_after, 0.8 * o.gap_before) << "rollouts on windows that no fit has seen";
  // friction takes half of the cost, the delay a quarter; a tenth is what the planner's samples and the noise may hide
  EXPECT_LT(o.after, 0.9 * o.before);
}

}  // namespace
}  // namespace tiller::bench
