#include "safety/output_gate.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "core/rng.hpp"

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
  EXPECT_EQ(gate.cuts(), 2u);
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

/// Any 64 bits read as a double: NaN payloads, denormals, both infinities, 1e308, all of it.
double any_double(Rng& rng) {
  const std::uint64_t bits = (std::uint64_t{rng.next_u32()} << 32) | rng.next_u32();
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

double adversarial(Rng& rng, double low, double high) {
  switch (rng.below(10)) {
    case 0: return kNan;
    case 1: return kInf;
    case 2: return -kInf;
    case 3: return std::numeric_limits<double>::max();
    case 4: return std::numeric_limits<double>::denorm_min();
    case 5: return low;
    case 6: return std::nextafter(high, kInf);
    case 7: return any_double(rng);
    default: return low + (high - low) * (1.5 * rng.uniform() - 0.25);
  }
}

TEST(OutputGate, NothingGetsThrough) {
  // one million commands in a thousand random gates, limits over 12 decades
  Rng rng(7, 100, 0);
  std::uint64_t cut = 0, rejected = 0;
  for (int g = 0; g < 1000; ++g) {
    GateLimits limits;
    limits.count = 1 + rng.below(TILLER_MAX_INPUTS);
    limits.period_s = std::pow(10.0, -4.0 * rng.uniform());
    for (std::uint32_t i = 0; i < limits.count; ++i) {
      const double scale = std::pow(10.0, 12.0 * rng.uniform() - 6.0);
      limits.low[i] = scale * rng.normal();
      limits.high[i] = limits.low[i] + (rng.below(8) == 0 ? 0.0 : scale * rng.uniform());
      limits.rate_per_s[i] = rng.below(4) == 0 ? kInf : scale * rng.uniform() / limits.period_s;
      limits.safe_command[i] = limits.low[i] + (limits.high[i] - limits.low[i]) * rng.uniform();
    }
    OutputGate gate(limits);
    double last[TILLER_MAX_INPUTS];
    std::memcpy(last, gate.last(), sizeof last);
    for (int k = 0; k < 1000; ++k) {
      double wanted[TILLER_MAX_INPUTS], hold[TILLER_MAX_INPUTS], out[TILLER_MAX_INPUTS];
      for (std::uint32_t i = 0; i < limits.count; ++i) {
        wanted[i] = adversarial(rng, limits.low[i], limits.high[i]);
        hold[i] = adversarial(rng, limits.low[i], limits.high[i]);
      }
      const double elapsed_s = rng.below(4) == 0 ? any_double(rng) : limits.period_s * 2.0 * rng.uniform();
      if (rng.below(50) == 0) {
        gate.send_safe(out);
        std::memcpy(last, out, sizeof last);
        continue;
      }
      (void)gate.pass(wanted, hold, elapsed_s, out);
      for (std::uint32_t i = 0; i < limits.count; ++i) {
        ASSERT_TRUE(std::isfinite(out[i]));
        ASSERT_GE(out[i], limits.low[i]);
        ASSERT_LE(out[i], limits.high[i]);
        // one rounding of last +- step is all that the subtraction here may see
        const double rounding = 4e-16 * (std::abs(out[i]) + std::abs(last[i]));
        ASSERT_LE(std::abs(out[i] - last[i]), limits.rate_per_s[i] * limits.period_s + rounding);
        last[i] = out[i];
      }
    }
    cut += gate.cuts();
    rejected += gate.rejections();
  }
  std::printf("1e6 commands: %llu cut, %llu rejected\n", static_cast<unsigned long long>(cut),
              static_cast<unsigned long long>(rejected));
  EXPECT_GT(cut, 100000u) << "the commands were too tame to test anything";
  EXPECT_GT(rejected, 100000u);
}

}  // namespace
}  // namespace tiller
