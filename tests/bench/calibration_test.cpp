// A small fixed part of ./dev bench calibration: rows whose intervals once did not cover what they claim.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "harness/calibration/calibration_run.hpp"

namespace tiller::bench {
namespace {

struct Case {
  Engine engine;
  const char* row;
};

class Calibration : public ::testing::TestWithParam<Case> {};

/// The row of the pendulum; of a long rest a shorter one.
CalibrationRow row_of(const Case& c) {
  const auto rows = calibration_rows();
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const CalibrationRow& r) {
    return r.engine == c.engine && r.run.physics.mechanism == Mechanism::pendulum && r.name == c.row;
  });
  if (found == rows.end()) return {};
  CalibrationRow row = *found;
  if (row.run.rest_ticks == 0) return row;
  row.run.ticks -= row.run.rest_ticks - 2000;
  row.run.rest_ticks = 2000;
  return row;
}

TEST_P(Calibration, IntervalsCoverWhatTheyClaim) {
  const CalibrationRow row = row_of(GetParam());
  ASSERT_GT(row.dimensions(), 0) << "no row " << GetParam().row;
  constexpr int kRuns = 40;
  std::vector<int> covered(static_cast<std::size_t>(row.dimensions()));
  int faults = 0;
  for (int i = 0; i < kRuns; ++i) {
    const CalibrationScore score = run_calibration(row, static_cast<std::uint64_t>(i) + 1, false);
    for (std::size_t j = 0; j < covered.size(); ++j) covered[j] += score.rank[j] > 0.05 && score.rank[j] < 0.95 ? 1 : 0;
    faults += score.fed.faults;
  }
  EXPECT_EQ(faults, 0);
  std::string line;
  for (const int n : covered) line += " " + std::to_string(n);
  std::printf("90 %% intervals cover%s of %d\n", line.c_str(), kRuns);
  // binomial at .9: below 29 comes once in 1,600 times
  for (const int n : covered) EXPECT_GE(n, 29);
}

INSTANTIATE_TEST_SUITE_P(
    Rows, Calibration,
    ::testing::Values(Case{Engine::filter, "plain"}, Case{Engine::filter, "30 % missing ticks"},
                      Case{Engine::filter, "one gap of 10 ticks"}, Case{Engine::filter, "process noise x3"},
                      Case{Engine::filter, "sensor noise x1/3"},
                      Case{Engine::filter, "10000 ticks at rest without process noise, then 400 in motion"},
                      Case{Engine::transition, "plain"}, Case{Engine::transition, "30 % missing ticks"},
                      Case{Engine::transition, "delay of 0.5 periods, hypotheses 0..2"},
                      Case{Engine::transition, "hidden Coulomb, discrepancy, position sd 0.0001"}),
    [](const auto& made) {
      std::string name = made.param.engine == Engine::filter ? "filter_" : "transition_";
      for (const char* c = made.param.row; *c; ++c) name += std::isalnum(static_cast<unsigned char>(*c)) ? *c : '_';
      return name;
    });

}  // namespace
}  // namespace tiller::bench
