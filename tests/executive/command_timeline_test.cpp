#include "executive/command_timeline.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"
#include "core/rng.hpp"

namespace {

using tiller::CommandTimeline;

class Timeline : public ::testing::Test {
 protected:
  Timeline() : storage_(1 << 14) {
    tiller::Arena arena = storage_.arena();
    timeline_.lay_out(arena, 1);
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
