#include "harness/faults/soak.hpp"

#include <gtest/gtest.h>

#include <cinttypes>

// A tenth of a million ticks here; ./dev bench robot makes 24 hours of them.

namespace tiller::faults {
namespace {

SoakCase short_soak() {
  SoakCase soak;
  soak.ticks = 100000;
  return soak;
}

void expect_clean(const SoakOutcome& o, std::uint64_t ticks) {
  EXPECT_EQ(o.ticks, ticks);
  EXPECT_EQ(o.faults, 0u) << tiller_status_name(o.first_fault);
  EXPECT_EQ(o.not_active, 0u);
  EXPECT_EQ(o.unanswered, 0u);
  EXPECT_EQ(o.heap_growth_bytes, 0);
  EXPECT_LT(o.worst_angle_rad, 0.2) << "it steered all the while";
}

TEST(Soak, NothingHappensAndNothingGrowsAndARepeatIsTheSameToTheLastBit) {
  const SoakCase soak = short_soak();
  const SoakOutcome first = run_soak(soak), second = run_soak(soak);
  expect_clean(first, soak.ticks);
  EXPECT_EQ(first.hash, second.hash);
  EXPECT_LE(second.resident_growth_bytes, 64 * 1024) << "a page or two of the process's own";
}

TEST(Soak, NumbersWrapAndClocksPassThirtyTwoBitsWithoutAnybodyNoticing) {
  SoakCase plain = short_soak(), wrapping = short_soak();
  plain.ticks = wrapping.ticks = 20000;
  wrapping.first_sequence = 0xffffffffu - 10000u;
  wrapping.first_stamp_us = (std::int64_t{1} << 32) - 100000000;  // half way through: 2^32 us
  const SoakOutcome a = run_soak(plain), b = run_soak(wrapping);
  expect_clean(b, wrapping.ticks);
  EXPECT_EQ(a.hash, b.hash) << "commands depend on differences of numbers and stamps alone";
}

TEST(Soak, ClocksAtOtherEdges) {
  for (const std::int64_t first_us : {(std::int64_t{1} << 31) - 1000000, (std::int64_t{1} << 53) - 1000000,
                                      std::int64_t{0x7fffffffffffffff} - 40000000, std::int64_t{-15000000}}) {
    SoakCase soak = short_soak();
    soak.ticks = 3000;
    soak.first_stamp_us = first_us;
    SCOPED_TRACE(first_us);
    expect_clean(run_soak(soak), soak.ticks);
  }
}

TEST(Soak, WhateverHappensItIsSafeComesBackAndARepeatIsTheSameToTheLastBit) {
  SoakCase soak;
  soak.ticks = 16000;  // each event once
  soak.eventful = true;
  const SoakOutcome first = run_soak(soak), second = run_soak(soak);
  for (int i = 0; i < static_cast<int>(SoakEvent::count); ++i)
    EXPECT_GT(first.events[i], 0u) << name_of(static_cast<SoakEvent>(i));
  EXPECT_EQ(first.unsafe, 0u);
  EXPECT_GT(first.resets, 0u);
  EXPECT_EQ(first.unrecovered, 0u);
  EXPECT_EQ(first.taken, 0u);
  EXPECT_EQ(first.not_finite, 0u);
  EXPECT_EQ(first.unanswered, 0u);
  EXPECT_EQ(first.heap_growth_bytes, 0);
  EXPECT_EQ(first.hash, second.hash);
}

}  // namespace
}  // namespace tiller::faults
