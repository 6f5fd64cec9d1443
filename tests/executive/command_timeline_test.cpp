#include "executive/command_timeline.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"
#include "core/rng.hpp"

namespace {

using tiller::CommandTimeline;

constexpr std::int64_t kWindow_us = 1000000;

class Timeline : public ::testing::Test {
 protected:
  Timeline() : storage_(1 << 14) {
    tiller::Arena arena = storage_.arena();
    timeline_.lay_out(arena, 1, kWindow_us);
  }
  void push(std::int64_t at_us, double value) { timeline_.push(at_us, &value); }
  double mean(std::int64_t reference_us, double from_s, double to_s) const {
    double value = -1.0;
    timeline_.mean(reference_us, from_s, to_s, &value);
    return value;
  }
  bench::Storage storage_;
  CommandTimeline timeline_;
};

TEST_F(Timeline, IsZeroBeforeAnything) { EXPECT_EQ(mean(0, 0.0, 1.0), 0.0); }

TEST_F(Timeline, HoldsEachCommandUntilTheNext) {
  push(1000, 0.1);
  push(3000, 5.0);
  EXPECT_EQ(mean(0, 0.001, 0.003), 0.1) << "exact: 0.1 survives no division";
  EXPECT_EQ(mean(0, 0.003, 9.0), 5.0);
  EXPECT_EQ(mean(0, -1.0, 0.002), 0.1) << "before the oldest: as the oldest";
  EXPECT_NEAR(mean(0, 0.002, 0.004), 2.55, 1e-12);
  EXPECT_EQ(mean(0, 0.002, 0.002), 0.1) << "an empty interval is a moment";
}

TEST_F(Timeline, ReferenceMayBeAnyEpoch) {
  const std::int64_t epoch_us = 1700000000000000;
  push(epoch_us, 1.0);
  push(epoch_us + 20000, 3.0);
  EXPECT_NEAR(mean(epoch_us + 30000, -0.02, 0.0), 2.0, 1e-9);
}

TEST_F(Timeline, CommandsDoNotOvertake) {
  push(1000, 1.0);
  push(3000, 3.0);
  push(2000, 2.0);  // sent later with less latency
  EXPECT_EQ(mean(0, 0.001, 0.003), 1.0);
  EXPECT_EQ(mean(0, 0.003, 0.005), 2.0) << "it takes the place of the one it met";
}

TEST_F(Timeline, RepeatsCostNoHistory) {
  push(0, 1.0);
  for (int i = 1; i <= 1000; ++i) push(i * 1000, 2.0);
  EXPECT_EQ(mean(0, -0.01, 0.001), 1.0) << "still known after a thousand repeats";
}

TEST_F(Timeline, KeepsAWholeWindowOfCommandsAtAKilohertz) {
  // a ramp of one a millisecond: a mean over the past is off by as much as its interval is misplaced
  const std::int64_t end_us = 5000000;
  for (std::int64_t t = 0; t < end_us; t += 1000) push(t, static_cast<double>(t) * 1e-3);
  // a window in 62 entries that hold for 16 or 32 ms each; both ends of an interval may fall within one
  const double grain = 32.0;
  for (double back_s = 0.02; back_s < 0.98; back_s += 0.01) {
    const double middle = 5000.0 - 0.5 - 1e3 * (back_s - 0.01);
    EXPECT_NEAR(mean(end_us, -back_s, -back_s + 0.02), middle, grain) << back_s;
  }
  EXPECT_NEAR(mean(end_us, -0.96, 0.0), 5000.0 - 0.5 - 480.0, 1.0) << "what was merged kept its mean";
  EXPECT_EQ(mean(end_us, -0.001, 0.0), 4999.0) << "the newest is as it was sent";
}

TEST_F(Timeline, ForgetsWhatNobodyAsksForBeforeItMerges) {
  // thirty commands a window: for as long as it runs, each of them is known exactly
  const std::int64_t period_us = kWindow_us / 30;
  for (int k = 0; k < 1000; ++k) push(k * period_us, k);
  for (int k = 970; k < 1000; ++k)
    EXPECT_EQ(mean(k * period_us, 0.0, 1e-6 * static_cast<double>(period_us)), k) << "to the last bit";
}

TEST_F(Timeline, MergesTheNeighboursThatHeldForTheShortestTime) {
  // 64 commands 10 ms apart, but for two that held for a millisecond and three
  std::int64_t at_us = 0;
  for (int k = 0; k < 64; ++k) {
    push(at_us, k);
    at_us += k == 30 ? 1000 : k == 31 ? 3000 : 10000;
  }
  push(at_us, 64.0);
  EXPECT_NEAR(mean(0, 0.300, 0.304), (30.0 * 1.0 + 31.0 * 3.0) / 4.0, 1e-12);
  EXPECT_EQ(mean(0, 0.290, 0.300), 29.0);
  EXPECT_EQ(mean(0, 0.304, 0.314), 32.0);
  EXPECT_EQ(mean(0, 0.0, 0.010), 0.0) << "the oldest is still there";
}

TEST_F(Timeline, OfEqualsTheOldestPairIsMerged) {
  const auto during = [&](int k) { return mean(0, 10000.0 * k * 1e-6, 10000.0 * (k + 1) * 1e-6); };
  for (int k = 0; k <= 64; ++k) push(k * 10000, k);
  EXPECT_EQ(during(0), 0.5) << "of the two only the mean is known";
  EXPECT_EQ(during(1), 0.5);
  for (int k = 2; k < 64; ++k) EXPECT_EQ(during(k), k) << "as they were sent";
}

TEST(TimelineOfTwo, IsThatOfEachInputAlone) {
  bench::Storage storage(1 << 14);
  tiller::Arena arena = storage.arena();
  CommandTimeline both, each[2];
  both.lay_out(arena, 2, kWindow_us);
  for (CommandTimeline& one : each) one.lay_out(arena, 1, kWindow_us);
  tiller::Rng rng(4, 50, 0);
  std::int64_t at_us = 0;
  for (int i = 0; i < 200; ++i) {  // more than are kept apart
    const double command[2] = {rng.normal(), rng.normal()};
    at_us += 1 + rng.below(9000);
    both.push(at_us, command);
    for (int k = 0; k < 2; ++k) each[k].push(at_us, command + k);
  }
  for (double back_s = 0.01; back_s < 0.6; back_s += 0.007) {
    double mean[2], alone;
    both.mean(at_us, -back_s, 0.005 - 0.5 * back_s, mean);
    for (int k = 0; k < 2; ++k) {
      each[k].mean(at_us, -back_s, 0.005 - 0.5 * back_s, &alone);
      EXPECT_EQ(mean[k], alone) << back_s;
    }
  }
}

TEST_F(Timeline, AgreesWithASampledMean) {
  // commands at random times against a mean over a fine grid
  tiller::Rng rng(3, 50, 0);
  std::vector<std::pair<std::int64_t, double>> pushed;
  std::int64_t at_us = 0;
  for (int i = 0; i < 60; ++i) {
    at_us += 1 + rng.below(30000);
    pushed.push_back({at_us, rng.normal()});
    push(at_us, pushed.back().second);
  }
  for (int k = 0; k < 200; ++k) {
    const std::int64_t from_us = pushed.front().first + rng.below(static_cast<std::uint32_t>(at_us)) / 10 * 10;
    const std::int64_t span_us = 10 + rng.below(8000) * 10;
    double sum = 0.0;
    for (std::int64_t t = from_us; t < from_us + span_us; ++t) {
      std::size_t i = pushed.size() - 1;
      while (i > 0 && pushed[i].first > t) --i;
      sum += pushed[i].second;
    }
    // microseconds are the grain of both: only rounding is between them
    EXPECT_NEAR(mean(0, 1e-6 * static_cast<double>(from_us), 1e-6 * static_cast<double>(from_us + span_us)),
                sum / static_cast<double>(span_us), 1e-9);
  }
}

}  // namespace
