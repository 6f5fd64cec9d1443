// What changed between two sets of logs of the same plant.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "harness/gap_scoring/gap_change.hpp"

namespace tiller::bench {
namespace {

ChangeRow row_of(const std::string& plant, const std::string& what, std::uint64_t seed) {
  ChangeWanted w;
  w.plant = plant;
  w.what = what;
  w.seed = seed;
  const ChangeRow row = run_change(w);
  std::printf("   %s: %s (%s) %s\n", row.id.c_str(), row.outcome.c_str(), row.answer.c_str(), row.note.c_str());
  return row;
}

class Changes : public testing::TestWithParam<const char*> {};

TEST_P(Changes, AreNamedWithTheirSize) {
  const ChangeRow row = row_of("pendulum", GetParam(), 1001);
  EXPECT_EQ(row.outcome, "named");
  EXPECT_NEAR(row.found, row.is - row.was, 0.1 * std::fabs(row.is - row.was));
  EXPECT_LT(row.low, row.found);
  EXPECT_GT(row.high, row.found);
}
INSTANTIATE_TEST_SUITE_P(Each, Changes, testing::Values("mass", "gain", "friction", "delay"));

TEST(Change, NothingIsToldOfARobotThatIsAsItWas) {
  for (const char* plant : {"pendulum", "linear_axis"}) EXPECT_EQ(row_of(plant, "none", 1001).verdict, "no_gap");
}

}  // namespace
}  // namespace tiller::bench
