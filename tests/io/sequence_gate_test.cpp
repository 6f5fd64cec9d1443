#include "io/sequence_gate.hpp"

#include <gtest/gtest.h>

namespace tiller {
namespace {

TEST(SequenceGate, OnlyNewerNumbersPass) {
  SequenceGate gate;
  EXPECT_TRUE(gate.accept(7, 0)) << "the first may be any";
  EXPECT_FALSE(gate.accept(7, 1)) << "a duplicate";
  EXPECT_FALSE(gate.accept(6, 2));
  EXPECT_TRUE(gate.accept(8, 3));
  EXPECT_TRUE(gate.accept(100, 4)) << "gaps are losses, not errors";
}

TEST(SequenceGate, ZeroFollowsTheLargestNumber) {
  SequenceGate gate;
  EXPECT_TRUE(gate.accept(0xffffffffu, 0));
  EXPECT_TRUE(gate.accept(0, 1));
  EXPECT_FALSE(gate.accept(0xffffffffu, 2));
}

TEST(SequenceGate, ARestartedPlantPassesOnlyAfterSilence) {
  SequenceGate gate;
  EXPECT_TRUE(gate.accept(5000, 0));
  EXPECT_FALSE(gate.accept(0, SequenceGate::kQuietUs - 1));
  EXPECT_TRUE(gate.accept(1, SequenceGate::kQuietUs));
  EXPECT_FALSE(gate.accept(1, SequenceGate::kQuietUs + 1)) << "and then the order holds again";
  EXPECT_TRUE(gate.accept(2, SequenceGate::kQuietUs + 2));
}

}  // namespace
}  // namespace tiller
