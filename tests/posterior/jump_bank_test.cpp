// Which hypotheses a bank keeps, and what they weigh together.

#include "posterior/filter/jump_bank.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace {

using tiller::JumpBank;

constexpr double kPeriod_s = 0.02;

/// A run in which every jump but those opened at `telling` ticks is as likely as none, and these by `gain` likelier.
struct Told {
  JumpBank bank;
  double likelihood[JumpBank::kLanes] = {};

  void go(int ticks, int telling = -1, double gain = 0.0) {
    bank.begin(-3.5, 0.0);
    for (int k = 1; k <= ticks; ++k) {
      if (!bank.tick()) continue;
      const std::uint32_t to = bank.make_room(likelihood, k * kPeriod_s), from = bank.likeliest(likelihood);
      likelihood[to] = likelihood[from] + (k == telling ? gain : 0.0);
      bank.open(to, from, {k * kPeriod_s, 0.0, 0.0});
    }
  }
};

TEST(JumpBank, DataThatSayNothingAreEvidenceOfNothing) {
  Told run;
  run.go(4000);
  EXPECT_NEAR(run.bank.jump_evidence(run.likelihood), 0.0, 1e-9) << "mergers keep the weight of both";
  EXPECT_NEAR(run.bank.walk_evidence(run.likelihood), 0.0, 1e-9);
}

TEST(JumpBank, TimesLieTheFartherApartTheOlderTheyAre) {
  Told run;
  run.go(4000);
  double age_s[JumpBank::kLanes - JumpBank::kFirstJump];
  for (std::uint32_t l = JumpBank::kFirstJump; l < JumpBank::kLanes; ++l)
    age_s[l - JumpBank::kFirstJump] = 4000 * kPeriod_s - run.bank.jump(l).time_s;
  std::sort(std::begin(age_s), std::end(age_s));
  EXPECT_LE(age_s[2], 1.0) << "late ones lie close";
  EXPECT_GE(*std::max_element(std::begin(age_s), std::end(age_s)), 0.25 * 4000 * kPeriod_s) << "early ones are there";
}

TEST(JumpBank, AJumpThatTheDataTellIsKept) {
  Told run;
  run.go(8000, 400, 20.0);
  const std::uint32_t lane = run.bank.likeliest_jump(run.likelihood);
  ASSERT_NE(lane, JumpBank::kNone);
  EXPECT_NEAR(run.likelihood[lane], 20.0, 1e-9);
  // four ticks of 8,000; what may have followed is a share of it
  EXPECT_NEAR(run.bank.jump_evidence(run.likelihood), 20.0 + std::log(4.0 / 8000.0), 1e-3);
}

TEST(JumpBank, AnUnlikelyLaneThatDiedIsGivenUpFirst) {
  Told run;
  run.go(JumpBank::kEvery * (JumpBank::kLanes - JumpBank::kFirstJump));
  run.likelihood[JumpBank::kFirstJump + 3] = -INFINITY;
  EXPECT_EQ(run.bank.make_room(run.likelihood, 10.0), JumpBank::kFirstJump + 3);
  EXPECT_TRUE(std::isfinite(run.bank.jump_evidence(run.likelihood)));
}

}  // namespace
