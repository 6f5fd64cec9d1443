#include "posterior/filter/shove_watch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace tiller {
namespace {

using Verdict = ShoveWatch::Verdict;

int count(ShoveWatch& watch, int ticks, double log_ratio, Verdict verdict) {
  int found = 0;
  for (int k = 0; k < ticks; ++k) found += watch.take(log_ratio) == verdict;
  return found;
}

TEST(ShoveWatch, SeldomFindsOneInAWorldThatTheParticlesDescribe) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  ShoveWatch watch;
  watch.reset(20);
  int shoves = 0, suspicious = 0;
  constexpr int kTicks = 1000000;
  for (int k = 0; k < kTicks; ++k) {
    const double z = normal(random), wide = 1.5;  // the other filter expects deviations half as large again
    const Verdict v = watch.take(0.5 * z * z * (1.0 - 1.0 / (wide * wide)) - std::log(wide));
    shoves += v == Verdict::shoved;
    suspicious += v == Verdict::suspicious;
  }
  EXPECT_LT(shoves, kTicks * std::exp(-8.0)) << "Page's test: less than once in exp(kShove) ticks";
  EXPECT_LT(suspicious, kTicks / 5);
}

TEST(ShoveWatch, FindsOneOnceItsLikelihoodIsHighEnough) {
  ShoveWatch watch;
  watch.reset(20);
  EXPECT_EQ(count(watch, 100, -1.0, Verdict::calm), 100);
  EXPECT_FALSE(watch.suspects());
  EXPECT_EQ(count(watch, 3, 2.0, Verdict::suspicious), 3);
  EXPECT_TRUE(watch.suspects());
  EXPECT_EQ(watch.take(2.0), Verdict::shoved);
  EXPECT_FALSE(watch.suspects());
}

TEST(ShoveWatch, AcquitsAfterTheLongestSuspicionAndWhereThereMayBeNone) {
  ShoveWatch watch;
  watch.reset(20);
  (void)watch.take(1.5);
  EXPECT_EQ(count(watch, 30, 0.01, Verdict::suspicious), 19);
  watch.reset(0);
  EXPECT_EQ(count(watch, 100, 5.0, Verdict::calm), 100);
}

TEST(ShoveWatch, FindsNoMoreThanAFewInARow) {
  ShoveWatch watch;
  watch.reset(20);
  EXPECT_EQ(count(watch, 100, 100.0, Verdict::shoved), 4);  // of two ticks each
  EXPECT_EQ(count(watch, 128, -1.0, Verdict::shoved), 0);
  EXPECT_GE(count(watch, 10, 100.0, Verdict::shoved), 1);
}

TEST(ShoveWatch, TakesOneReadingForTheSensors) {
  ShoveWatch watch;
  watch.reset(20);
  EXPECT_EQ(watch.take(100.0), Verdict::suspicious);
  EXPECT_EQ(watch.take(-100.0), Verdict::calm) << "the reading after a glitch is where it was before";
  EXPECT_EQ(watch.take(100.0), Verdict::suspicious);
  EXPECT_EQ(watch.take(0.0), Verdict::shoved);
}

TEST(ShoveWatch, TakesWhatIsNoNumberForNothing) {
  ShoveWatch watch;
  watch.reset(20);
  EXPECT_EQ(watch.take(std::nan("")), Verdict::calm);
  EXPECT_EQ(count(watch, 4, 2.0, Verdict::shoved), 1);
}

}  // namespace
}  // namespace tiller
