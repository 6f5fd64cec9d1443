// The gate's last word on what the cones made of a command. A process of its own, in which the cones make whatever a
// test says: those of OutputGate keep to limits and rates by themselves, but for roundings.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "safety/gate.h"

namespace {

double from_cones = 0.0;

}  // namespace

tiller_status_t tiller_gate_apply_cones(const tiller_gate_cones_t*, const tiller_gate_t*, double, double* u) {
  u[0] = from_cones;
  return tiller_status_ok;
}

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

/// One input in [-4, 4] at a rate of 1/s, a second a period; `last` went out.
tiller_gate_t gate_at(double last) {
  tiller_gate_t gate{};
  gate.count = 1;
  gate.low[0] = -4.0, gate.high[0] = 4.0, gate.rate_per_s[0] = 1.0, gate.period_s = 1.0;
  gate.safe_command[0] = last;
  tiller_gate_settle(&gate);
  return gate;
}

bool passes(double last, double made) {
  tiller_gate_t gate = gate_at(last);
  const tiller_gate_cones_t* const some = reinterpret_cast<const tiller_gate_cones_t*>(&gate);  // is not looked into
  from_cones = made;
  double out = 0.0;
  const tiller_status_t status = tiller_gate_pass(&gate, some, &last, &last, 1.0, &out);
  EXPECT_EQ(out, status == tiller_status_ok ? made : last);
  return status == tiller_status_ok;
}

// Requirement: SR-1, SR-2
TEST(GateRounding, WhatConesMakeGoesOutWithinLimitsAndRatesAlone) {
  EXPECT_TRUE(passes(0.0, 0.5));
  EXPECT_TRUE(passes(0.0, 1.0));
  EXPECT_TRUE(passes(0.0, -1.0));
  EXPECT_FALSE(passes(0.0, 1.0 + 1e-9)) << "too fast upwards";
  EXPECT_FALSE(passes(0.0, -1.0 - 1e-9)) << "and downwards";
  EXPECT_FALSE(passes(3.9, 4.1)) << "above";
  EXPECT_FALSE(passes(-3.9, -4.1)) << "below";
  for (const double none : {kNan, kInf, -kInf}) EXPECT_FALSE(passes(0.0, none)) << none;
}

// last + 1 rounds to 1 and the difference of the next number to `last` rounds to 1 as well: either sum is enough.
TEST(GateRounding, EitherOfTheTwoSumsIsEnough) {
  const double half = std::ldexp(1.0, -53), next = 1.0 + std::ldexp(1.0, -52);
  ASSERT_GT(next, half + 1.0);
  ASSERT_EQ(next - half, 1.0);
  EXPECT_TRUE(passes(half, next));
  EXPECT_TRUE(passes(-half, -next));
}

TEST(GateRounding, APeriodThatIsNotPositiveAllowsNoChange) {
  for (const double period_s : {0.0, -1.0}) {
    tiller_gate_t gate = gate_at(0.5);
    gate.period_s = period_s;
    const double wanted = 1.0;
    double out = 0.0;
    EXPECT_EQ(tiller_gate_pass(&gate, nullptr, &wanted, &wanted, 1.0, &out), tiller_status_rate_limited);
    EXPECT_EQ(out, 0.5);
  }
}

TEST(GateRounding, NoMoreInputsThanThereIsRoomFor) {
  tiller_gate_t gate{};
  gate.count = TILLER_MAX_INPUTS + 1;
  tiller_gate_settle(&gate);
  EXPECT_EQ(gate.count, std::uint32_t{TILLER_MAX_INPUTS});
}

}  // namespace
