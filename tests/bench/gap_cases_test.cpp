// `tiller gap` on a fixed dozen of worlds: what every build must still be able to name. The figures are of
// ./dev bench gap; these are a few of its tuning cases, each with an effect of at least five sensor deviations.

#include <gtest/gtest.h>

#include "harness/gap_scoring/gap_cases.hpp"

namespace tiller::bench {
namespace {

GapRow run(const char* section, const char* plant, const std::vector<std::string>& kinds, Excitation excitation,
           double process_sd = 0) {
  GapCase c;
  c.section = section;
  c.seed = kFirstTuningSeed;
  c.wanted.plant = plant;
  c.wanted.kinds = kinds;
  c.wanted.noise_sd = 2e-3;
  c.wanted.excitation = excitation;
  c.wanted.process_sd = process_sd;
  c.wanted.least_r = 5;
  c.wanted.seed = 16 * kFirstTuningSeed;
  return run_case(c, ::testing::TempDir() + "gap_cases_test", false);
}

TEST(GapCases, SingleEffectsAreNamed) {
  const std::pair<const char*, const char*> cases[] = {
      {"pendulum", "viscous_friction"}, {"pendulum", "coulomb_friction"}, {"pendulum", "actuator_lag"},
      {"pendulum", "constant_offset"},  {"cart_pole", "input_delay"},     {"cart_pole", "coulomb_friction"}};
  for (const auto& [plant, kind] : cases) {
    const GapRow row = run("sealed", plant, {kind}, Excitation::open_loop);
    EXPECT_EQ(row.outcome, "exact") << row.id << ": " << row.verdict << " " << row.sets << " " << row.note;
    EXPECT_LT(row.gap_after, row.gap_before) << row.id;
  }
}

TEST(GapCases, NothingHiddenIsNoGap) {
  for (const Excitation e : {Excitation::open_loop, Excitation::pd_tracking}) {
    const GapRow row = run("null", "pendulum", {}, e, 0.02);
    EXPECT_EQ(row.outcome, "none") << row.id << ": " << row.verdict << " " << row.sets;
  }
}

TEST(GapCases, ARowSurvivesItsFile) {
  GapRow row;
  row.id = "sealed/x/y/0.1/1";
  row.note = "a, b";
  row.r = 3.25;
  row.seed = 7;
  const std::string path = ::testing::TempDir() + "gap_rows.csv";
  std::FILE* file = std::fopen(path.c_str(), "w");
  ASSERT_NE(file, nullptr);
  std::fputs((row_header() + row_text(row) + "cut,while,it,was").c_str(), file);
  std::fclose(file);
  const std::vector<GapRow> rows = read_rows(path);
  ASSERT_EQ(rows.size(), 1u) << "the line that was cut does not count";
  EXPECT_EQ(rows[0].id, row.id);
  EXPECT_EQ(rows[0].note, "a; b");
  EXPECT_EQ(rows[0].r, 3.25);
  EXPECT_EQ(rows[0].seed, 7u);
}

TEST(GapCases, ScoringAndTuningSeedsNeverMeet) {
  CasePlan scoring, tuning;
  scoring.seeds = tuning.seeds = 3;
  tuning.first_seed = kFirstTuningSeed;
  for (const char* section : {"sealed", "null", "two", "outside"}) {
    const auto a = plan_cases(section, scoring), b = plan_cases(section, tuning);
    ASSERT_EQ(a.size(), b.size());
    for (const GapCase& x : a) EXPECT_LT(x.wanted.seed, 16 * kFirstTuningSeed) << x.id();
    for (const GapCase& x : b) EXPECT_GE(x.wanted.seed, 16 * kFirstTuningSeed) << x.id();
  }
}

}  // namespace
}  // namespace tiller::bench
