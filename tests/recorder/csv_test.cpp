// The CSV of a run is a log that replays: what is read back is the tick that was written.
#include <algorithm>
#include <sstream>

#include "run_rig.hpp"
#include "tools/replay/replay.hpp"

namespace tiller::tools {
namespace {

/// As the recorder writes it: numbers of every kind, infinite and missing ones among them.
std::string write_run(const RobotFile& robot, const std::string& path, std::uint64_t ticks,
                      LoggedTick (*tick_of)(std::uint64_t) = odd_tick) {
  RunLog log(robot, false, {});
  log.open(path);
  for (std::uint64_t k = 0; k < ticks; ++k) {
    LoggedTick tick = tick_of(k);
    const tiller_record_t& r = tick.entry.record;
    tick.info.planner_iterations = r.planner_iterations;
    std::copy(std::begin(r.state_mean), std::end(r.state_mean), tick.info.state_mean);
    std::copy(std::begin(r.param_mean), std::end(r.param_mean), tick.info.param_mean);
    std::copy(std::begin(r.param_sd), std::end(r.param_sd), tick.info.param_sd);
    tick.status = static_cast<tiller_status_t>(r.status);
    log.add(tick);
  }
  EXPECT_TRUE(log.close());
  return bytes_of(path);
}

/// What a controller is given, and what is compared with its answer.
void expect_same_inputs(const RecordEntry& a, const RecordEntry& b) {
  const tiller_record_t &x = a.record, &y = b.record;
  EXPECT_EQ(x.tick, y.tick);
  EXPECT_EQ(x.now_us, y.now_us);
  EXPECT_EQ(x.calls, y.calls);
  EXPECT_EQ(a.stop_status, b.stop_status);
  EXPECT_EQ(x.planner_iterations, y.planner_iterations);
  EXPECT_EQ(x.status, y.status);
  EXPECT_EQ(x.command.state, y.command.state);
  EXPECT_PRED2(same_double, x.command.value[0], y.command.value[0]);
  EXPECT_PRED2(same_double, x.state_mean[0], y.state_mean[0]);
  EXPECT_PRED2(same_double, x.param_mean[0], y.param_mean[0]);
  EXPECT_PRED2(same_double, x.param_sd[0], y.param_sd[0]);
  ASSERT_EQ(x.has_measurement, y.has_measurement);
  if (x.has_measurement == 0) return;
  EXPECT_EQ(x.measurement.stamp_us, y.measurement.stamp_us);
  EXPECT_EQ(x.measurement.sequence, y.measurement.sequence);
  EXPECT_EQ(x.measurement.command_latency_us, y.measurement.command_latency_us);
  for (int i = 0; i < 2; ++i) EXPECT_PRED2(same_double, x.measurement.value[i], y.measurement.value[i]) << x.tick;
}

TEST(CsvRun, EveryTickComesBackToTheLastBit) {
  const Folder folder;
  const auto robot = arm();
  (void)write_run(*robot, folder / "run.csv", 200);
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_recorded_run(folder / "run.csv", *robot, run, error)) << error;
  EXPECT_FALSE(run.has_config);
  EXPECT_FALSE(run.cut_off);
  EXPECT_EQ(run.note, "");
  ASSERT_EQ(run.entries.size(), 200u);
  for (std::uint64_t k = 0; k < 200; ++k) expect_same_inputs(odd_tick(k).entry, run.entries[k]);
}

TEST(CsvRun, ForcesComeBackAndWhereALogHasNoneItSaysSo) {
  const Folder folder;
  const auto robot = pushed_arm();
  (void)write_run(*robot, folder / "pushed.csv", 50, pushed_tick);
  (void)write_run(*arm(), folder / "still.csv", 50);
  for (const bool pushed : {true, false}) {
    RecordedRun run;
    std::string error;
    ASSERT_TRUE(read_recorded_run(folder / (pushed ? "pushed.csv" : "still.csv"), *robot, run, error)) << error;
    ASSERT_EQ(run.entries.size(), 50u);
    for (std::uint64_t k = 0; k < 50; ++k)
      expect_same_forces(pushed ? pushed_tick(k).entry : odd_tick(k).entry, run.entries[k]);
    EXPECT_EQ(run.note, pushed ? "" : "the forces beyond the model are not in it");
  }
}

TEST(CsvRun, CutAtEveryByteItsWholeRowsAreRead) {
  const Folder folder;
  const auto robot = arm();
  const std::string whole = write_run(*robot, folder / "run.csv", 4);
  const std::size_t header = whole.find('\n') + 1;
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const std::string text = whole.substr(0, size);
    const auto rows = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
    RecordedRun run;
    std::string error;
    std::istringstream file(text);
    ASSERT_EQ(read_csv_run(file, "cut.csv", *robot, run, error), rows > 1) << size;
    ASSERT_EQ(run.entries.size(), rows > 1 ? rows - 1 : 0) << size;
    ASSERT_EQ(run.cut_off, size > header && text.back() != '\n') << size;
  }
}

TEST(CsvRun, WhatIsNoRowIsToldWithItsLineAndColumn) {
  const Folder folder;
  const auto robot = arm();
  const std::string whole = write_run(*robot, folder / "run.csv", 3);
  const auto told = [&](const std::string& from, const std::string& to) {
    std::string text = whole;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    RecordedRun run;
    std::string error;
    std::istringstream file(text);
    EXPECT_FALSE(read_csv_run(file, "run.csv", *robot, run, error)) << to;
    return error;
  };
  EXPECT_NE(told("now_us", "then_us").find("run.csv:2: it has no column now_us"), std::string::npos);
  EXPECT_NE(told(",ACTIVE,", ",awake,").find("run.csv:2: column state holds 'awake'"), std::string::npos);
  EXPECT_NE(told(",1000000,", ",1e6,").find("run.csv:2: column now_us holds '1e6'"), std::string::npos);
  EXPECT_NE(told("\n0.010000,", "\n0.010000,7,").find("run.csv:3: not as many cells"), std::string::npos);
  EXPECT_NE(told("angle_rad", "tilt_rad").find("no column angle_rad"), std::string::npos);
}

/// Any bytes: told or read, never more entries than rows.
TEST(CsvRun, AnyBytesAreTakenOrRefused) {
  const Folder folder;
  const auto robot = arm();
  const std::string whole = write_run(*robot, folder / "run.csv", 3);
  std::uint32_t random = 1;
  const auto next = [&] { return random = random * 1664525u + 1013904223u, random >> 8; };
  std::size_t taken = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    std::string text = whole;
    for (std::uint32_t i = 0; i < 1 + next() % 4; ++i) text[next() % text.size()] = static_cast<char>(next());
    RecordedRun run;
    std::string error;
    std::istringstream file(text);
    const bool read = read_csv_run(file, "run.csv", *robot, run, error);
    ASSERT_NE(read, !error.empty());
    ASSERT_LT(run.entries.size(), static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n')) + 1);
    taken += read ? 1 : 0;
  }
  EXPECT_GT(taken, 1000u) << "damage inside numbers reads as other numbers";
}

}  // namespace
}  // namespace tiller::tools
