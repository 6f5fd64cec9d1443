// What an answer of `tiller gap` counts as: the rules that every figure of ./dev bench gap rests on.

#include "harness/gap_scoring/gap_score.hpp"

#include <gtest/gtest.h>

#include "effects/effect_info.hpp"

namespace tiller::bench {
namespace {

const EffectSet kTruth = {"coulomb_friction@cart"};

Outcome outcome(const char* verdict, const std::vector<EffectSet>& sets, const EffectSet& truth = kTruth) {
  return judge(truth, {verdict, sets});
}

/// A pair of kinds that the catalogue calls aliases.
std::pair<std::string, std::string> some_aliases() {
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind)
    if (const char* alias = effect_info(kind).aliases[0]) return {effect_info(kind).name, alias};
  return {};
}

TEST(GapScore, TheTruthAloneIsExact) {
  EXPECT_EQ(outcome("named", {kTruth}), Outcome::exact);
  EXPECT_EQ(outcome("named", {{"b@x", "a@x"}}, {"a@x", "b@x"}), Outcome::exact) << "order has no meaning";
}

TEST(GapScore, TheRightKindAtTheWrongPortIsWrong) {
  EXPECT_EQ(outcome("named", {{"coulomb_friction@pole"}}), Outcome::wrong);
}

TEST(GapScore, ASetThatHoldsTheTruthBesideAnotherStructureIsNotExact) {
  EXPECT_EQ(outcome("ambiguous", {{"cubic_spring@cart"}, kTruth}), Outcome::in_set);
}

TEST(GapScore, AStructuralClassIsExactOnlyWhereItIsReported) {
  const auto [a, b] = some_aliases();
  ASSERT_FALSE(a.empty());
  const EffectSet truth = {a + "@x"}, alias = {b + "@y"};
  EXPECT_EQ(outcome("ambiguous", {alias, truth}, truth), Outcome::exact);
  EXPECT_EQ(outcome("ambiguous", {truth, alias}, alias), Outcome::exact) << "either way round";
  EXPECT_EQ(outcome("named", {alias}, truth), Outcome::wrong);
  EXPECT_EQ(outcome("ambiguous", {truth, alias, {"payload@body"}}, truth),
            structurally_equal({"payload@body"}, truth) ? Outcome::exact : Outcome::in_set);
}

TEST(GapScore, FrictionOfTwoLevelsIsCoulombAndAForce) {
  const EffectSet one = {"asymmetric_friction@x", "backlash@u"};
  const EffectSet two = {"backlash@u", "constant_offset@x", "coulomb_friction@x"};
  EXPECT_TRUE(structurally_equal(one, two));
  EXPECT_EQ(outcome("named", {two, one}, one), Outcome::exact);
  EXPECT_EQ(outcome("named", {two}, one), Outcome::wrong) << "not reported";
  EXPECT_FALSE(structurally_equal(one, {"backlash@u", "constant_offset@y", "coulomb_friction@x"}));
}

TEST(GapScore, ExtraNamesAreWrongAndMissingOnesArePart) {
  EXPECT_EQ(outcome("named", {{"coulomb_friction@cart", "payload@body"}}), Outcome::wrong);
  EXPECT_EQ(outcome("named", {kTruth}, {"coulomb_friction@cart", "payload@body"}), Outcome::part);
  EXPECT_EQ(outcome("ambiguous", {{"payload@body", "cogging@cart"}, kTruth}, {"coulomb_friction@cart", "payload@body"}),
            Outcome::part);
}

TEST(GapScore, PartlyExplainedIsNeverExact) {
  EXPECT_EQ(outcome("partly_explained", {kTruth}), Outcome::in_set);
  EXPECT_EQ(outcome("partly_explained", {{"payload@body"}}), Outcome::wrong);
}

TEST(GapScore, SilenceIsNotWrong) {
  EXPECT_EQ(outcome("no_gap", {}), Outcome::none);
  EXPECT_EQ(outcome("unnamed", {}), Outcome::unnamed);
  EXPECT_EQ(outcome("unfit", {}), Outcome::unfit);
}

TEST(GapScore, ANameWhereNothingIsHiddenIsWrong) {
  EXPECT_EQ(outcome("named", {kTruth}, {}), Outcome::wrong);
  EXPECT_EQ(outcome("no_gap", {}, {}), Outcome::none);
  EXPECT_EQ(outcome("unnamed", {}, {}), Outcome::unnamed);
}

TEST(GapScore, SetsSurviveTheirText) {
  const EffectSet set = {"b@y", "a@x"};
  EXPECT_EQ(joined(set), "a@x+b@y");
  EXPECT_EQ(joined(split_set(joined(set))), joined(set));
  EXPECT_TRUE(split_set("none").empty());
}

}  // namespace
}  // namespace tiller::bench
