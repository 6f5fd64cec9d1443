// Logs that are copies of others, as a shell's *.csv names them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "tools/logs/repeated_logs.hpp"

namespace tiller::tools {
namespace {

Log run(const std::string& path, double phase, std::size_t rows = 400) {
  Log log;
  log.path = path;
  log.state.resize(2);
  log.input.resize(1);
  for (std::size_t i = 0; i < rows; ++i) {
    log.time_s.push_back(0.02 * static_cast<double>(i));
    log.state[0].push_back(std::sin(0.1 * static_cast<double>(i) + phase));
    log.input[0].push_back(0.3);
  }
  return log;
}

// The rows from `first` on, written with ten digits and stamped anew.
Log tail(const Log& of, std::size_t first, const std::string& path) {
  Log log = of;
  log.path = path;
  log.time_s.clear();
  log.state[0].clear();
  log.input[0].clear();
  for (std::size_t i = first; i < of.rows(); ++i) {
    char text[40];
    std::snprintf(text, sizeof text, "%.10g", of.state[0][i]);
    log.time_s.push_back(of.time_s[i] - of.time_s[first] + 1.5e-6 * static_cast<double>(i % 3));  // rounded twice
    log.state[0].push_back(std::atof(text));
    log.input[0].push_back(0.3);
  }
  return log;
}

TEST(RepeatedLogs, AnAlarmsCopyAndAFileGivenTwiceAreLeftOut) {
  const Log one = run("run1.csv", 0), two = run("run2.csv", 0.537);
  std::vector<Log> logs{tail(one, 137, "run1.alarm.csv"), one, two, two};
  const std::vector<std::string> said = drop_repeated(logs);
  ASSERT_EQ(logs.size(), 2u);
  EXPECT_EQ(logs[0].path, "run1.csv");
  EXPECT_EQ(logs[1].path, "run2.csv");
  ASSERT_EQ(said.size(), 2u);
  EXPECT_EQ(said[0], "run1.alarm.csv: all of its rows stand in run1.csv too; it is left out.");
}

TEST(RepeatedLogs, OtherRunsStay) {
  Log other = tail(run("a.csv", 0), 100, "b.csv");
  other.state[0][150] += 1e-6;  // an encoder's noise differs somewhere
  std::vector<Log> logs{run("a.csv", 0), other, run("c.csv", 1e-7)};
  EXPECT_TRUE(drop_repeated(logs).empty());
  EXPECT_EQ(logs.size(), 3u);
}

// Two robots at rest read the same.
TEST(RepeatedLogs, RowsThatDoNotMoveAreNoProof) {
  Log still = run("a.csv", 0);
  for (double& v : still.state[0]) v = 0.25;
  Log other = still;
  other.path = "b.csv";
  std::vector<Log> logs{still, other};
  EXPECT_TRUE(drop_repeated(logs).empty());
}

TEST(RepeatedLogs, MissingSamplesHaveToBeMissingInBoth) {
  Log one = run("a.csv", 0);
  for (std::size_t i = 0; i < one.rows(); i += 3) one.state[0][i] = NAN;
  EXPECT_TRUE(is_part_of(one, one));
  Log filled = run("b.csv", 0);
  EXPECT_FALSE(is_part_of(one, filled));
}

TEST(RepeatedLogs, HeldOutRowsThatAreLearntFromAreTold) {
  const Log one = run("run1.csv", 0);
  EXPECT_EQ(shared_logs({one, run("run2.csv", 0.537)}, {tail(one, 200, "proof.csv")}).size(), 1u);
  EXPECT_TRUE(shared_logs({one}, {run("run3.csv", 0.211)}).empty());
}

}  // namespace
}  // namespace tiller::tools
