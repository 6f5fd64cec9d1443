#include "safety/output_gate.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>

#include "harness/gate_storm/gate_storm.hpp"

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kPeriod_s = 0.02;

GateLimits two_inputs() {
  GateLimits limits;
  limits.count = 2;
  limits.period_s = kPeriod_s;
  limits.low[0] = -20.0, limits.high[0] = 20.0, limits.rate_per_s[0] = 400.0;  // 8 a period
  limits.low[1] = 0.0, limits.high[1] = 1.0, limits.rate_per_s[1] = kInf;
  limits.safe_command[1] = 0.25;
  return limits;
}

TEST(OutputGate, PassesWhatIsWithinTheLimits) {
  OutputGate gate(two_inputs());
  const double wanted[] = {7.5, 0.75}, hold[] = {0.0, 0.0};
  double out[2];
  EXPECT_EQ(gate.pass(wanted, hold, kPeriod_s, out), tiller_status_ok);
  EXPECT_EQ(out[0], 7.5);
  EXPECT_EQ(out[1], 0.75);
  EXPECT_EQ(gate.cuts(), 0u);
  EXPECT_EQ(gate.last()[0], 7.5);
}

TEST(OutputGate, StartsFromTheSafeCommand) {
  OutputGate gate(two_inputs());
  EXPECT_EQ(gate.last()[0], 0.0);
  EXPECT_EQ(gate.last()[1], 0.25);
}

TEST(OutputGate, CutsToLimitsAndRatesAndCounts) {
  OutputGate gate(two_inputs());
  const double hold[] = {0.0, 0.0};
  double out[2];
  const double above[] = {5.0, 3.0};
  EXPECT_EQ(gate.pass(above, hold, kPeriod_s, out), tiller_status_command_limited);
  EXPECT_EQ(out[1], 1.0);
  const double fast[] = {-20.0, 0.5};
  EXPECT_EQ(gate.pass(fast, hold, kPeriod_s, out), tiller_status_rate_limited);
  EXPECT_DOUBLE_EQ(out[0], -3.0);  // 5 - 8
  const double below[] = {-3.0, -1.0};
  EXPECT_EQ(gate.pass(below, hold, kPeriod_s, out), tiller_status_command_limited) << "not its rate";
  EXPECT_EQ(out[1], 0.0);
  EXPECT_EQ(gate.cuts(), 3u);
  EXPECT_EQ(gate.rejections(), 0u);
}

TEST(OutputGate, RoundingOfASinglePrecisionPlannerIsCutButNotReported) {
  OutputGate gate(two_inputs());
  const double hold[] = {0.0, 0.0};
  double out[2];
  const double wanted[] = {8.0 * (1.0 + 6e-8), 1.0 + 6e-8};
  EXPECT_EQ(gate.pass(wanted, hold, kPeriod_s, out), tiller_status_ok);
  EXPECT_LE(out[0], 8.0);
  EXPECT_EQ(out[1], 1.0);
  EXPECT_EQ(gate.cuts(), 0u);
}

// Requirement: SR-2
TEST(OutputGate, ChangeIsBoundedByTheShorterOfPeriodAndElapsedTime) {
  const double wanted[] = {20.0, 0.0}, hold[] = {0.0, 0.0};
  // elapsed time, allowed change; stamps are whole microseconds, hence 400/s * 1 us = 4e-4 of grain
  const double cases[][2] = {{0.0, 0.0}, {-1.0, 0.0}, {0.005, 2.0}, {0.02, 8.0},
                             {0.1, 8.0}, {kInf, 8.0}, {kNan, 0.0},  {-kInf, 0.0}};
  for (const auto& c : cases) {
    OutputGate gate(two_inputs());
    double out[2];
    (void)gate.pass(wanted, hold, c[0], out);
    EXPECT_NEAR(out[0], c[1], 4.001e-4) << "elapsed " << c[0];
  }
}

// Requirement: SR-1
TEST(OutputGate, NotFiniteBecomesTheFallbackAndThatPassesTheLimitsToo) {
  for (double bad : {kNan, kInf, -kInf}) {
    OutputGate gate(two_inputs());
    const double wanted[] = {1.0, bad};
    const double hold[] = {-100.0, 0.5};
    double out[2];
    EXPECT_EQ(gate.pass(wanted, hold, kPeriod_s, out), tiller_status_command_not_finite);
    EXPECT_DOUBLE_EQ(out[0], -8.0) << "the whole command is replaced, and limited";
    EXPECT_EQ(out[1], 0.5);
    EXPECT_EQ(gate.rejections(), 1u);
  }
}

TEST(OutputGate, FallbackThatIsNotFiniteBecomesTheSafeCommand) {
  OutputGate gate(two_inputs());
  const double wanted[] = {kNan, 0.0}, hold[] = {0.0, kNan};
  double out[2];
  EXPECT_EQ(gate.pass(wanted, hold, kPeriod_s, out), tiller_status_command_not_finite);
  EXPECT_EQ(out[0], 0.0);
  EXPECT_EQ(out[1], 0.25);
  EXPECT_EQ(gate.pass(nullptr, nullptr, kPeriod_s, out), tiller_status_command_not_finite);
  EXPECT_EQ(out[1], 0.25);
}

TEST(OutputGate, SafeCommandIgnoresTheRateLimit) {
  OutputGate gate(two_inputs());
  const double wanted[] = {20.0, 1.0}, hold[] = {0.0, 0.0};
  double out[2];
  for (int i = 0; i < 5; ++i) (void)gate.pass(wanted, hold, kPeriod_s, out);
  ASSERT_EQ(out[0], 20.0);
  gate.send_safe(out);
  EXPECT_EQ(out[0], 0.0);
  EXPECT_EQ(out[1], 0.25);
  EXPECT_EQ(gate.last()[0], 0.0) << "the next rate limit starts from what was sent";
}

// Requirement: SR-1
TEST(OutputGate, NonsenseLimitsLeaveTheSafeCommandAlone) {
  GateLimits limits;
  limits.count = 4;
  limits.period_s = kPeriod_s;
  limits.low[0] = 1.0, limits.high[0] = -1.0, limits.safe_command[0] = 0.5;     // reversed
  limits.low[1] = kNan, limits.high[1] = 1.0, limits.safe_command[1] = 0.25;    // not a number
  limits.low[2] = -kInf, limits.high[2] = kInf, limits.safe_command[2] = kNan;  // no limit is no limit set
  limits.low[3] = 2.0, limits.high[3] = 3.0,
  limits.safe_command[3] = 0.0;  // safe command outside: brought in
  OutputGate gate(limits);
  const double wanted[] = {9.0, 9.0, 9.0, 9.0};
  double out[4];
  (void)gate.pass(wanted, wanted, kPeriod_s, out);
  EXPECT_EQ(out[0], 0.5);
  EXPECT_EQ(out[1], 0.25);
  EXPECT_EQ(out[2], 0.0);
  EXPECT_EQ(out[3], 2.0);
}

/// Two tangential forces within half of the normal one, plus 1.
GateLimits friction() {
  GateLimits limits;
  limits.count = 3;
  limits.period_s = kPeriod_s;
  for (int i = 0; i < 3; ++i) limits.low[i] = -10.0, limits.high[i] = 10.0, limits.rate_per_s[i] = kInf;
  limits.low[2] = -2.0;
  const tiller_input_cone_t cone = {0b011, 2, 0.5, 1.0};
  limits.cones = make_input_cones(&cone, 1);
  return limits;
}

// Requirement: SR-11
TEST(OutputGate, CutsToAConeForTheAxisThatGoesOut) {
  OutputGate gate(friction());
  const double hold[] = {0.0, 0.0, 0.0}, wide[] = {6.0, 8.0, 40.0};
  double out[3];
  EXPECT_EQ(gate.pass(wide, hold, kPeriod_s, out), tiller_status_command_limited);
  EXPECT_NEAR(out[0], 3.6, 1e-14);  // 1 + 0.5 * 10 = 6 in the direction of (3, 4) / 5
  EXPECT_NEAR(out[1], 4.8, 1e-14);
  EXPECT_EQ(out[2], 10.0);
  const double inside[] = {1.0, -1.0, 4.0};
  EXPECT_EQ(gate.pass(inside, hold, kPeriod_s, out), tiller_status_ok);
  EXPECT_EQ(out[1], -1.0);
  const double apex[] = {1.0, 1.0, -5.0};
  (void)gate.pass(apex, hold, kPeriod_s, out);
  EXPECT_EQ(out[0], 0.0);
  EXPECT_EQ(out[2], -2.0);
  EXPECT_EQ(gate.cuts(), 2u);
}

// Requirement: SR-2, SR-11
TEST(OutputGate, RatesHoldOnTheConesToo) {
  GateLimits limits = friction();
  limits.rate_per_s[0] = 50.0;  // 1 a period
  OutputGate gate(limits);
  const double hold[] = {0.0, 0.0, 0.0}, push[] = {4.0, 0.0, 6.0}, let_go[] = {0.0, 0.0, -2.0};
  double out[3];
  for (int k = 0; k < 5; ++k) (void)gate.pass(push, hold, kPeriod_s, out);
  EXPECT_EQ(out[0], 4.0);
  // the normal force may not go at once: the tangential one would be left outside
  EXPECT_EQ(gate.pass(let_go, hold, kPeriod_s, out), tiller_status_rate_limited);
  EXPECT_NEAR(out[0], 3.0, 1e-12);
  EXPECT_NEAR(out[2], 4.0, 1e-12);
}

TEST(OutputGate, ConesHaveNothingToDoWithWhatStandsBehindTheLastInput) {
  GateLimits limits = friction();
  limits.low[3] = limits.high[3] = 0.0;
  OutputGate gate(limits);
  const double hold[] = {0.0, 0.0, 0.0, 0.0}, inside[] = {1.0, -1.0, 4.0, 5.0};
  double out[] = {0.0, 0.0, 0.0, 1e9};
  EXPECT_EQ(gate.pass(inside, hold, kPeriod_s, out), tiller_status_ok);
  EXPECT_EQ(out[3], 1e9);
  EXPECT_EQ(gate.cuts(), 0u);
}

TEST(OutputGate, InNoTimeNothingMoves) {
  GateLimits limits = friction();
  limits.cones = {};
  for (double& rate : limits.rate_per_s) rate = 50.0;
  OutputGate gate(limits);
  const double hold[] = {0.0, 0.0, 0.0}, wanted[] = {4.0, -4.0, 4.0};
  double out[3];
  for (const double elapsed_s : {0.0, -1.0}) {
    EXPECT_EQ(gate.pass(wanted, hold, elapsed_s, out), tiller_status_rate_limited);
    for (const double u : out) EXPECT_EQ(u, 0.0);
  }
}

TEST(OutputGate, ACommandOnTheConeIsNotCut) {
  OutputGate gate(friction());
  const double hold[] = {0.0, 0.0, 0.0};
  double out[3];
  for (int k = 0; k < 1000; ++k) {  // half of which rounding puts beyond it
    const double wanted[] = {3.0 * std::cos(0.01 * k), 3.0 * std::sin(0.01 * k), 4.0};
    EXPECT_EQ(gate.pass(wanted, hold, kPeriod_s, out), tiller_status_ok) << k;
  }
  EXPECT_EQ(gate.cuts(), 0u);
}

TEST(OutputGate, ASafeCommandMayStandAtALimit) {
  for (const double side : {1.0, -1.0}) {
    GateLimits limits = friction();
    (side > 0.0 ? limits.low : limits.high)[0] = 0.0;
    limits.safe_command[0] = 3.0 * side;
    limits.safe_command[2] = -2.0;  // where the cone has no radius
    OutputGate gate(limits);
    double out[3];
    gate.send_safe(out);
    EXPECT_EQ(out[0], 0.0);
    EXPECT_EQ(out[2], -2.0);
  }
}

TEST(OutputGate, EveryInputHasItsOwnSafeCommand) {
  GateLimits limits;
  limits.count = TILLER_MAX_INPUTS;
  limits.period_s = kPeriod_s;
  for (int i = 0; i < TILLER_MAX_INPUTS; ++i) {
    limits.low[i] = -20.0, limits.high[i] = 20.0, limits.rate_per_s[i] = kInf;
    limits.safe_command[i] = 1.0 + i;
  }
  OutputGate gate(limits);
  double out[TILLER_MAX_INPUTS] = {};
  gate.send_safe(out);
  for (int i = 0; i < TILLER_MAX_INPUTS; ++i) EXPECT_EQ(out[i], 1.0 + i);
  const double wanted[TILLER_MAX_INPUTS] = {2.5, 1.5};
  double around[TILLER_MAX_INPUTS + 1] = {};
  around[TILLER_MAX_INPUTS] = 7.0;
  for (int k = 0; k < 3; ++k) EXPECT_EQ(gate.pass(wanted, wanted, kPeriod_s, around), tiller_status_ok);
  for (int i = 0; i < TILLER_MAX_INPUTS; ++i) EXPECT_EQ(around[i], wanted[i]);
  EXPECT_EQ(around[TILLER_MAX_INPUTS], 7.0);
  EXPECT_EQ(gate.cuts(), 0u);
  EXPECT_EQ(gate.rejections(), 0u);
}

TEST(OutputGate, ACutOfOneInputByTheConeIsTold) {
  for (int i = 0; i < 2; ++i) {
    OutputGate gate(friction());
    double wanted[] = {0.0, 0.0, 4.0}, out[3] = {};
    wanted[i] = 8.0;
    EXPECT_EQ(gate.pass(wanted, out, kPeriod_s, out), tiller_status_command_limited) << i;
    EXPECT_NEAR(out[i], 3.0, 1e-14);
  }
}

TEST(OutputGate, HoldAndSafeCommandsPassTheConesToo) {
  GateLimits limits = friction();
  limits.safe_command[0] = 3.0;  // outside of the cone, whose radius is 1 here
  OutputGate gate(limits);
  double out[3];
  gate.send_safe(out);
  EXPECT_EQ(out[0], 1.0);
  const double lost[] = {kNan, 0.0, 0.0}, hold[] = {9.0, 0.0, 0.0};
  EXPECT_EQ(gate.pass(lost, hold, kPeriod_s, out), tiller_status_command_not_finite);
  EXPECT_EQ(out[0], 1.0);
}

TEST(OutputGate, ConesThatTheLimitsDoNotFitLeaveTheSafeCommandAlone) {
  for (int fault = 0; fault < 7; ++fault) {
    GateLimits limits = friction();
    if (fault == 0) limits.cones.cone[0].limit = kNan;
    if (fault == 1) limits.low[2] = -3.0;  // 1 - 0.5 * 3 is below 0
    if (fault == 2) limits.low[0] = 0.5, limits.safe_command[0] = 0.5;
    if (fault == 3) limits.cones.cone[0].inputs = 0b1011;
    if (fault == 4) limits.cones.cone[0].slope = kNan;
    if (fault == 5) limits.cones.cone[0].axis = 3;
    if (fault == 6) limits.cones.cone[0].inputs = 0b111;  // the axis stands in the norm
    OutputGate gate(limits);
    const double wanted[] = {2.0, 1.0, 3.0};
    double out[3];
    (void)gate.pass(wanted, wanted, kPeriod_s, out);
    EXPECT_EQ(out[0], limits.safe_command[0]) << fault;
    EXPECT_EQ(out[2], limits.safe_command[2]) << fault;
  }
}

TEST(OutputGate, AConeWithoutASlopeReadsNoAxis) {
  GateLimits limits = friction();
  limits.cones.cone[0].slope = 0.0, limits.cones.cone[0].axis = 99;
  OutputGate gate(limits);
  const double wanted[] = {3.0, 4.0, 3.0};
  double out[3];
  EXPECT_EQ(gate.pass(wanted, wanted, kPeriod_s, out), tiller_status_command_limited);
  EXPECT_NEAR(std::hypot(out[0], out[1]), 1.0, 1e-12);
  EXPECT_EQ(out[2], 3.0);
}

// Requirement: SR-1, SR-2, SR-11
TEST(OutputGate, NothingGetsThrough) {
  // one million here; ./dev bench robot sends a hundred million
  const StormResult r = GateStorm(7).run(1000000);
  std::printf("1e6 commands: %llu cut, %llu rejected\n", static_cast<unsigned long long>(r.cut),
              static_cast<unsigned long long>(r.rejected));
  EXPECT_EQ(r.not_finite, 0u);
  EXPECT_EQ(r.beyond_limit, 0u);
  EXPECT_EQ(r.beyond_rate, 0u);
  EXPECT_EQ(r.beyond_cone, 0u);
  EXPECT_EQ(r.altered, 0u) << "a gate that lets nothing through is no gate";
  EXPECT_GT(r.cut, 100000u) << "the commands were too tame to test anything";
  EXPECT_GT(r.rejected, 100000u);
}

}  // namespace
}  // namespace tiller
