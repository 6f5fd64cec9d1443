// What sensors tell of a motion, in the two limits that are known exactly, and between them against a Kalman filter.

#include "planners/probe_sight.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tiller/tiller.h"

namespace tiller {
namespace {

constexpr std::uint32_t kLanes = 16, kSteps = 20;

StateSpread spread_of(const tiller_model_t& model, double sensor_sd, double process_sd, double period_s) {
  StateSpread spread;
  spread.states = model.state_count;
  double sd[TILLER_MAX_STATES] = {};
  sd[1] = process_sd;
  fill_process_covariance(model, sd, period_s, spread.process);
  for (std::uint32_t i = 0; i < model.state_count; ++i) spread.sensor_variance[i] = HUGE_VAL;
  spread.sensor_variance[0] = sensor_sd * sensor_sd;
  return spread;
}

/// Lane l accelerates by l * 0.1: positions at / 2 t^2.
std::vector<float> parabolas(double period_s) {
  std::vector<float> x((kSteps + 1) * 2 * kLanes);
  for (std::uint32_t step = 0; step <= kSteps; ++step)
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      const double t = step * period_s, a = 0.1 * l;
      x[(step * 2) * kLanes + l] = static_cast<float>(0.5 * a * t * t);
      x[(step * 2 + 1) * kLanes + l] = static_cast<float>(a * t);
    }
  return x;
}

double apart(const std::vector<float>& signal, std::uint32_t rows, std::uint32_t a, std::uint32_t b) {
  double sum = 0.0;
  for (std::uint32_t r = 0; r < rows; ++r) {
    const double d = static_cast<double>(signal[r * kLanes + a]) - static_cast<double>(signal[r * kLanes + b]);
    sum += 0.5 * d * d;
  }
  return sum;
}

TEST(ProbeSight, WithoutDisturbanceItIsTheDistanceOfTheMeasurementsInTheirNoise) {
  const tiller_model_t* model = tiller_find_model("linear_axis");
  const double period_s = 0.02, noise = 0.003;
  ProbeSight sight;
  sight.design(*model, period_s, spread_of(*model, noise, 0.0, period_s));
  ASSERT_EQ(sight.signals(), 1u);
  std::vector<float> signal(kSteps * kLanes);
  sight.whiten(parabolas(period_s).data(), kSteps, kLanes, signal.data());
  double exact = 0.0;
  for (std::uint32_t step = 1; step <= kSteps; ++step) {
    const double t = step * period_s, d = 0.5 * 0.8 * t * t / noise;  // accelerations .3 and 1.1
    exact += 0.5 * d * d;
  }
  EXPECT_NEAR(apart(signal, kSteps, 3, 11), exact, 1e-4 * exact);
}

TEST(ProbeSight, OfASensorWithoutNoiseItIsTheChangeWithinAPeriod) {
  const tiller_model_t* model = tiller_find_model("linear_axis");
  const double period_s = 0.02, process = 0.5;
  StateSpread spread = spread_of(*model, 1e-9, process, period_s);
  spread.sensor_variance[1] = 1e-18;  // and the velocity
  ProbeSight sight;
  sight.design(*model, period_s, spread);
  ASSERT_EQ(sight.signals(), 2u);
  std::vector<float> signal(kSteps * 2 * kLanes);
  sight.whiten(parabolas(period_s).data(), kSteps, kLanes, signal.data());
  // a difference of acceleration a is an increment (a dt^2 / 2, a dt) under Q = q^2 [dt^3/3 dt^2/2; dt^2/2 dt] each
  // period: a^2 dt / q^2, half of it a nat
  const double a = 0.8, exact = kSteps * 0.5 * a * a * period_s / (process * process);
  EXPECT_NEAR(apart(signal, 2 * kSteps, 3, 11), exact, 0.02 * exact);
}

TEST(ProbeSight, ASlowDifferenceUnderDisturbanceTellsLessThanAFastOne) {
  const tiller_model_t* model = tiller_find_model("linear_axis");
  const double period_s = 0.02;
  ProbeSight sight;
  sight.design(*model, period_s, spread_of(*model, 0.003, 0.3, period_s));
  std::vector<float> x((kSteps + 1) * 2 * kLanes, 0.0f), signal(kSteps * kLanes);
  const double size = 0.02;  // of both, at their ends
  for (std::uint32_t step = 0; step <= kSteps; ++step) {
    x[(step * 2) * kLanes + 1] = static_cast<float>(size * step / kSteps);
    x[(step * 2) * kLanes + 2] = step < kSteps / 2 ? 0.0f : static_cast<float>(size);
    x[(step * 2 + 1) * kLanes + 1] = static_cast<float>(size / (kSteps * period_s));
  }
  sight.whiten(x.data(), kSteps, kLanes, signal.data());
  EXPECT_LT(10.0 * apart(signal, kSteps, 0, 1), apart(signal, kSteps, 0, 2));
}

TEST(ProbeSight, WhatIsKnownOfTheStateAtTheStartTellsNothing) {
  const tiller_model_t* model = tiller_find_model("linear_axis");
  ProbeSight sight;
  sight.design(*model, 0.02, spread_of(*model, 0.003, 0.1, 0.02));
  std::vector<float> x((kSteps + 1) * 2 * kLanes, 0.0f), signal(kSteps * kLanes);
  for (std::uint32_t step = 0; step <= kSteps; ++step) {  // lane 1 stands elsewhere and goes its way
    x[(step * 2) * kLanes + 1] = 0.5f + 0.3f * 0.02f * static_cast<float>(step);
    x[(step * 2 + 1) * kLanes + 1] = 0.3f;
  }
  sight.whiten(x.data(), kSteps, kLanes, signal.data());
  EXPECT_LT(apart(signal, kSteps, 0, 1), 1e-4);
}

}  // namespace
}  // namespace tiller
