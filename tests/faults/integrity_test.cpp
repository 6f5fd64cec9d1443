#include "harness/faults/integrity.hpp"

#include <gtest/gtest.h>

// A hundredth of what ./dev bench robot integrity counts; tests/core and tests/sim have the patterns one by one.

namespace tiller::faults {
namespace {

void expect_none(const IntegrityRow& row) {
  EXPECT_GE(row.trials, 10000u);
  EXPECT_EQ(row.passed, 0u);
}

TEST(Integrity, NoFlipOfOneOrTwoBitsPasses) {
  expect_none(flips_of_board(10000));
  expect_none(flips_of_status(10000));
  expect_none(flips_of_sealed(10000));
}

TEST(Integrity, NothingRepeatedOrReplayedPasses) {
  expect_none(disorder_of_board(10000));
  expect_none(disorder_of_sealed(10000));
}

}  // namespace
}  // namespace tiller::faults
