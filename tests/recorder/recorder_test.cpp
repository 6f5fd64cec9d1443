// The tick hands over and goes on, whatever the disk does.
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "run_rig.hpp"
#include "tools/logs/mcap_reader.hpp"
#include "tools/replay/replay.hpp"

namespace tiller::tools {
namespace {

TEST(SpscRing, IsFullAndEmptyWhereItShould) {
  SpscRing<int> ring(3);
  EXPECT_EQ(ring.front(), nullptr);
  for (int k = 0; k < 100; ++k) {
    for (int i = 0; i < 3; ++i) EXPECT_TRUE(ring.push(3 * k + i));
    EXPECT_FALSE(ring.push(-1));
    for (int i = 0; i < 3; ++i) {
      ASSERT_NE(ring.front(), nullptr);
      EXPECT_EQ(*ring.front(), 3 * k + i);
      ring.pop();
    }
    EXPECT_EQ(ring.front(), nullptr);
  }
}

// A million items between two threads: none lost, none twice, none torn.
TEST(SpscRing, KeepsTheOrderBetweenThreads) {
  struct Pair {
    std::uint64_t a = 0, b = 0;
  };
  SpscRing<Pair> ring(64);
  constexpr std::uint64_t kItems = 1000000;
  std::thread writer([&] {
    for (std::uint64_t k = 0; k < kItems;)
      if (ring.push({k, ~k})) ++k;
  });
  std::uint64_t wrong = 0;
  for (std::uint64_t k = 0; k < kItems;) {
    const Pair* item = ring.front();
    if (!item) continue;
    wrong += item->a != k || item->b != ~k;
    ring.pop();
    ++k;
  }
  writer.join();
  EXPECT_EQ(wrong, 0u);
}

TEST(Recorder, WritesEveryFormatAndTellsTheSame) {
  const Folder folder;
  const auto robot = arm();
  RecorderOptions options;
  options.log = folder / "run.csv";
  options.records = {folder / "run.rec", folder / "run.mcap", folder / "run.lcm"};
  options.lossless = true;
  Recorder recorder(*robot, options);
  recorder.start(robot->config);
  constexpr std::uint64_t kTicks = 3000;  // more than the ring holds
  for (std::uint64_t k = 0; k < kTicks; ++k) recorder.push(odd_tick(k));
  const RecorderReport report = recorder.stop();
  EXPECT_TRUE(report.complete);
  EXPECT_EQ(recorder.state().status, tiller_status_ok);
  EXPECT_EQ(report.ticks, kTicks);
  EXPECT_EQ(report.dropped_ticks, 0u);
  EXPECT_EQ(report.readable_log, options.log);
  const std::string csv = bytes_of(options.log);
  EXPECT_EQ(static_cast<std::uint64_t>(std::count(csv.begin(), csv.end(), '\n')), kTicks + 1);
  for (int i = 0; i < 2; ++i) {
    RecordedRun run;
    std::string error;
    ASSERT_TRUE(read_recorded_run(options.records[static_cast<std::size_t>(i)], *robot, run, error)) << error;
    ASSERT_EQ(run.entries.size(), kTicks);
    for (std::uint64_t k = 0; k < kTicks; k += 97) expect_same(odd_tick(k).entry.record, run.entries[k].record);
  }
}

/// A pipe that nobody reads is the slowest of disks: the writer's thread hangs in write().
TEST(Recorder, ADiskThatHangsCostsTicksAndNoTime) {
  const Folder folder;
  const std::string pipe = folder / "run.csv";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const int reader = ::open(pipe.c_str(), O_RDONLY | O_NONBLOCK);
  ASSERT_GE(reader, 0);
  const auto robot = arm();
  RecorderOptions options;
  options.log = pipe;
  Recorder recorder(*robot, options);
  recorder.start(robot->config);
  // until the pipe is full, so that the thread hangs in its write; a push that waited for it would wait for ever
  std::uint64_t pushed = 0;
  for (int held = 0; held < 60000; ioctl(reader, FIONREAD, &held)) {
    recorder.push(odd_tick(pushed++));
    if (pushed % 200 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const std::uint64_t before = recorder.dropped();
  for (int i = 0; i < 5000; ++i) recorder.push(odd_tick(pushed++));
  const std::uint64_t dropped = recorder.dropped();
  EXPECT_GE(dropped - before, 5000 - 256u) << "the ring holds 256";
  EXPECT_EQ(recorder.state().status, tiller_status_queue_full) << "while it lasts";
  EXPECT_EQ(recorder.state().dropped_ticks, dropped);
  // the disk comes back: what is in the ring is written, and the run ends well
  std::string got;
  std::thread drain([&] {
    (void)fcntl(reader, F_SETFL, 0);
    char bytes[65536];
    for (ssize_t n; (n = ::read(reader, bytes, sizeof bytes)) > 0;) got.append(bytes, static_cast<std::size_t>(n));
  });
  const RecorderReport report = recorder.stop();
  drain.join();
  ::close(reader);
  EXPECT_FALSE(report.complete);
  EXPECT_EQ(report.ticks, pushed);
  EXPECT_EQ(report.dropped_ticks, dropped - 1) << "the last one is kept";
  const auto rows = static_cast<std::uint64_t>(std::count(got.begin(), got.end(), '\n'));
  EXPECT_EQ(rows, pushed - report.dropped_ticks + 1) << "every tick is written or counted";
  // the log tells by its numbers what it lacks, and the report tells the same
  RecordedRun run;
  std::string error;
  std::istringstream text(got);
  ASSERT_TRUE(read_csv_run(text, pipe, *robot, run, error)) << error;
  find_holes(run);
  EXPECT_EQ(run.entries.back().record.tick, pushed - 1);
  ASSERT_EQ(run.holes.size(), report.holes.size());
  std::uint64_t missing = 0;
  for (std::size_t i = 0; i < run.holes.size(); ++i) {
    EXPECT_EQ(run.holes[i].first, report.holes[i].first);
    EXPECT_EQ(run.holes[i].last, report.holes[i].last);
    missing += run.holes[i].last - run.holes[i].first + 1;
  }
  EXPECT_EQ(missing, report.dropped_ticks);
  ASSERT_FALSE(report.messages.empty());
  EXPECT_NE(report.messages.back().find("were not recorded (" + std::to_string(run.holes[0].first) + " to "),
            std::string::npos)
      << report.messages.back();
  std::printf("%llu ticks, %llu dropped, %llu rows\n", static_cast<unsigned long long>(pushed),
              static_cast<unsigned long long>(dropped), static_cast<unsigned long long>(rows - 1));
}

/// The alarm's window looks back, and goes on.
TEST(Recorder, AnAlarmKeepsWhatCameBefore) {
  const Folder folder;
  const auto robot = arm();
  RecorderOptions options;
  options.alarm_log = folder / "alarm.csv";
  options.alarm_log_s = 1.0;
  options.lossless = true;
  Recorder recorder(*robot, options);
  recorder.start(robot->config);
  for (std::uint64_t k = 0; k < 500; ++k) {
    LoggedTick tick = odd_tick(k);
    tick.entry.record.has_measurement = 1;
    tick.entry.record.measurement.stamp_us = tick.entry.record.now_us;
    tick.entry.record.status = tiller_status_ok;
    tick.alarm = k == 300;
    recorder.push(tick);
  }
  const RecorderReport report = recorder.stop();
  EXPECT_EQ(report.alarm_log, options.alarm_log);
  EXPECT_NEAR(report.alarm_log_s, 1.0, 0.011);
  const std::string csv = bytes_of(options.alarm_log);
  EXPECT_EQ(csv.rfind("time_s,angle_rad,rate_rad_s,torque_Nm\n0.000000,", 0), 0u) << csv.substr(0, 100);
  EXPECT_NEAR(static_cast<double>(std::count(csv.begin(), csv.end(), '\n')), 101, 1);
}

}  // namespace
}  // namespace tiller::tools
