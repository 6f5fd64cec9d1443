// Logs of LCM: what we write liblcm reads, and the ticks are put together again from messages.
#include <lcm/eventlog.h>

#include <functional>

#include "run_rig.hpp"
#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tiller_lcm/telemetry_t.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/replay/replay.hpp"

namespace tiller::tools {
namespace {

/// Ticks whose numbers are finite: LCM has no bit for infinity, and NaN comes back as a missing value.
LoggedTick plain_tick(std::uint64_t k) {
  LoggedTick tick = odd_tick(k);
  tiller_record_t& r = tick.entry.record;
  r.measurement.value[0] = 1.0 / (3.0 + static_cast<double>(k));
  r.measurement.value[1] = k % 7 == 3 ? std::nan("") : -0.25 * static_cast<double>(k);
  if (r.has_measurement == 0) r.measurement = {};
  r.plan_cost = 4.0 / 3.0;
  tick.info.status = r.status;
  tick.info.planner_iterations = r.planner_iterations;
  tick.info.tick_ns = r.tick_ns;
  tick.info.plan_cost = r.plan_cost;
  tick.info.effective_samples = r.effective_samples;
  tick.info.noise_scale = r.noise_scale;
  tick.info.state_mean[0] = r.state_mean[0];
  tick.info.param_mean[0] = r.param_mean[0];
  tick.info.param_sd[0] = r.param_sd[0];
  return tick;
}

std::string write_run(const RobotFile& robot, const std::string& path, std::uint64_t ticks) {
  LcmLog log(robot);
  log.open(path, 77);
  for (std::uint64_t k = 0; k < ticks; ++k) {
    const LoggedTick tick = plain_tick(k);
    log.add(tick.entry, tick.info);
  }
  EXPECT_TRUE(log.close());
  return bytes_of(path);
}

std::size_t events_in(const std::string& path) {
  lcm_eventlog_t* log = lcm_eventlog_create(path.c_str(), "r");
  std::size_t count = 0;
  while (lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(log)) {
    EXPECT_EQ(event->eventnum, static_cast<std::int64_t>(count));
    ++count;
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(log);
  return count;
}

TEST(LcmLog, EveryTickComesBackToTheLastBit) {
  const Folder folder;
  const auto robot = arm();
  (void)write_run(*robot, folder / "run.lcm", 50);
  EXPECT_EQ(events_in(folder / "run.lcm"), 140u);  // a measurement in four ticks of five
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_recorded_run(folder / "run.lcm", *robot, run, error)) << error;
  EXPECT_EQ(run.note, "");
  EXPECT_FALSE(run.has_config);
  ASSERT_EQ(run.entries.size(), 50u);
  for (std::uint64_t k = 0; k < 50; ++k) expect_same(plain_tick(k).entry.record, run.entries[k].record);
}

TEST(LcmLog, ForcesComeBackAndWhereALogHasNoneItSaysSo) {
  const Folder folder;
  const auto robot = pushed_arm();
  constexpr std::uint64_t kTicks = 50;
  for (const bool pushed : {true, false}) {
    LcmLog log(*robot);
    log.open(folder / "run.lcm", 77);
    for (std::uint64_t k = 0; k < kTicks; ++k) {
      LoggedTick tick = plain_tick(k);
      const tiller_info_t& force = pushed_tick(k).info;
      tick.info.force_joints = pushed ? force.force_joints : 0;
      tick.info.touched = force.touched;
      tick.info.force_mean[0] = force.force_mean[0];
      tick.info.force_sd[0] = force.force_sd[0];
      log.add(tick.entry, tick.info);
    }
    ASSERT_TRUE(log.close());
    EXPECT_EQ(events_in(folder / "run.lcm"), pushed ? 190u : 140u);
    RecordedRun run;
    std::string error;
    ASSERT_TRUE(read_recorded_run(folder / "run.lcm", *robot, run, error)) << error;
    ASSERT_EQ(run.entries.size(), kTicks);
    for (std::uint64_t k = 0; k < kTicks; ++k) {
      expect_same(plain_tick(k).entry.record, run.entries[k].record);
      expect_same_forces(pushed ? pushed_tick(k).entry : plain_tick(k).entry, run.entries[k]);
    }
    EXPECT_EQ(run.note, pushed ? "" : "the forces beyond the model are not in it");
  }
}

TEST(LcmLog, CutAtEveryByteItsWholeMessagesAreRead) {
  const Folder folder;
  const auto robot = arm();
  const std::string whole = write_run(*robot, folder / "run.lcm", 3);
  std::size_t before = 0;
  for (std::size_t size = 0; size <= whole.size(); size += size < whole.size() && size + 7 > whole.size() ? 1 : 7) {
    std::ofstream(folder / "cut.lcm", std::ios::binary) << whole.substr(0, size);
    const std::size_t events = events_in(folder / "cut.lcm");
    ASSERT_GE(events, before);
    before = events;
    RecordedRun run;
    std::string error;
    const bool good = read_lcm_run(folder / "cut.lcm", *robot, run, error);
    if (events < 2) {
      ASSERT_FALSE(good);
    } else {
      ASSERT_TRUE(good) << size << " " << error;
    }
  }
  EXPECT_EQ(before, 9u);
}

// ---- logs of lcm-logger ------------------------------------------------------------------------------------------

class Logger {
 public:
  explicit Logger(const std::string& path) : log_(lcm_eventlog_create(path.c_str(), "w")) {}
  ~Logger() { lcm_eventlog_destroy(log_); }
  Logger(const Logger&) = delete;
  Logger& operator=(const Logger&) = delete;

  void measurement(std::uint32_t sequence, std::int64_t stamp_us, double value = 0) {
    tiller_lcm::measurement_t m{};
    m.stamp_us = stamp_us;
    m.sequence = sequence;
    m.count = 2;
    m.valid_mask = 3;
    m.value[0] = 0.5 * sequence + value;
    write("TILLER_MEASUREMENT", m);
  }
  void command(std::uint32_t sequence, std::int64_t stamp_us, int state = tiller_state_active) {
    tiller_lcm::command_t c{};
    c.stamp_us = stamp_us;
    c.sequence = sequence;
    c.state = state;
    c.count = 1;
    c.value[0] = 0.25;
    write("TILLER_COMMAND", c);
  }
  void telemetry(std::int64_t tick, std::int64_t stamp_us, int status = 0, int fault = 0) {
    tiller_lcm::telemetry_t t{};
    t.tick = tick;
    t.stamp_us = stamp_us;
    t.status = status;
    t.first_fault = fault;
    t.tick_ns = 2000000;
    t.planner_iterations = 3;
    write("TILLER_TELEMETRY", t);
  }

 private:
  template <class Message>
  void write(const char* channel, const Message& message) {
    char bytes[1024];
    lcm_eventlog_event_t event{};
    event.eventnum = number_++;
    event.timestamp = number_;
    event.channellen = static_cast<int>(std::strlen(channel));
    event.channel = const_cast<char*>(channel);
    event.datalen = message.encode(bytes, 0, sizeof bytes);
    event.data = bytes;
    ASSERT_EQ(lcm_eventlog_write_event(log_, &event), 0);
  }
  lcm_eventlog_t* log_;
  std::int64_t number_ = 0;
};

TEST(LcmLog, TicksArePutTogetherFromWhatALoggerHeard) {
  const Folder folder;
  const auto robot = arm();
  const std::string path = folder / "logger.lcm";
  {
    Logger log(path);
    log.command(0, 1000, tiller_state_standby);  // the tool waits for the robot's start: no tick
    log.measurement(1, 10000);
    log.command(1, 10700);
    log.telemetry(1, 10700);
    log.measurement(2, 20000);  // superseded before it was read
    log.measurement(3, 30000);
    log.command(3, 30500);
    log.telemetry(2, 30500);
    log.command(3, 45000);  // nothing new came
    log.telemetry(3, 45000, tiller_status_no_new_measurement);
    log.measurement(4, 50000);
    log.command(3, 50600);  // the guard refused number 4
    log.telemetry(4, 50600, tiller_status_sensor_jump);
    log.measurement(5, 60000);
    log.command(5, 60400);
    log.measurement(6, 70000);
    log.telemetry(5, 60400);
    log.command(6, 70400);  // its telemetry was lost
    log.measurement(7, 80000);
    log.command(7, 80200, tiller_state_safe);
    log.telemetry(7, 80200, tiller_status_actuator_fault, tiller_status_actuator_fault);
    for (int i = 0; i < 3; ++i) log.command(7, 80200, tiller_state_standby);  // the end of the run
  }
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_recorded_run(path, *robot, run, error)) << error;
  EXPECT_EQ(run.note, "");
  ASSERT_EQ(run.entries.size(), 7u);
  const std::uint32_t expected[] = {1, 3, 0, 4, 5, 6, 7};  // the measurement that each tick was given; 0: none
  for (std::size_t i = 0; i < 7; ++i) {
    const tiller_record_t& r = run.entries[i].record;
    EXPECT_EQ(r.has_measurement != 0 ? r.measurement.sequence : 0, expected[i]) << i;
    EXPECT_EQ(r.planner_iterations, i == 5 ? kIterationsUnknown : 3u) << i;
    EXPECT_EQ(r.calls & 15u, static_cast<std::uint32_t>(i == 0 ? tiller_call_arm : tiller_call_prepare)) << i;
  }
  // the latency that the host foresaw: age of the measurement and a running mean of the tick's length, 2 ms each
  EXPECT_EQ(run.entries[0].record.measurement.command_latency_us, 700u);
  EXPECT_EQ(run.entries[1].record.measurement.command_latency_us, 500u + 200u);
  EXPECT_EQ(run.entries[6].record.calls >> 4 & 15u, static_cast<std::uint32_t>(tiller_call_stop));
  EXPECT_EQ(run.entries[6].stop_status, static_cast<std::uint32_t>(tiller_status_actuator_fault));
}

class Holes : public testing::Test {
 protected:
  /// The run that a logger heard.
  RecordedRun read(const std::function<void(Logger&)>& write) {
    const std::string path = folder_ / "logger.lcm";
    {
      Logger log(path);
      write(log);
    }
    RecordedRun run;
    error_.clear();
    (void)read_lcm_run(path, *robot_, run, error_);
    return run;
  }
  /// A tick in lockstep: number, and sequence of its measurement.
  static void tick(Logger& log, std::uint32_t sequence, std::int64_t number) {
    log.measurement(sequence, 10000 * sequence);
    log.command(sequence, 10000 * sequence);
    if (number > 0) log.telemetry(number, 10000 * sequence);
  }

  const Folder folder_;
  const std::unique_ptr<RobotFile> robot_ = arm();
  std::string error_;
};

TEST_F(Holes, AWholeLogHasNone) {
  const RecordedRun run = read([&](Logger& log) {
    for (std::uint32_t k = 1; k < 4; ++k) tick(log, k, k);
  });
  EXPECT_EQ(run.note, "");
  EXPECT_FALSE(run.cut_off);
  EXPECT_EQ(sound_ticks(run), 3u);
}

TEST_F(Holes, TicksThatAreMissingAreNamed) {
  const RecordedRun late = read([&](Logger& log) {
    for (std::uint32_t k = 5; k < 8; ++k) tick(log, k, k);
  });
  EXPECT_EQ(
      late.note,
      "4 ticks are missing: 0 to 3; from tick 4 on a replay knows other things than the recorded controller did: no "
      "equal bits are promised");
  EXPECT_TRUE(late.cut_off);
  EXPECT_EQ(sound_ticks(late), 0u);
  const RecordedRun two = read([&](Logger& log) {
    for (std::uint32_t k = 1; k < 12; ++k)
      if (k != 3 && k != 4 && k != 9) tick(log, k, k);
  });
  EXPECT_EQ(two.note.find("3 ticks are missing: 2 to 3, 8; from tick 4 on"), 0u) << two.note;
  EXPECT_EQ(sound_ticks(two), 2u);
}

TEST_F(Holes, AMeasurementThatIsMissingIsNamed) {
  const RecordedRun run = read([&](Logger& log) {
    for (std::uint32_t k = 1; k < 8; ++k) {
      if (k != 5) log.measurement(k, 10000 * k);
      log.command(k, 10000 * k);
      log.telemetry(k, 10000 * k);
    }
  });
  EXPECT_EQ(run.note.find("1 tick's measurement is missing: 4; from tick 4 on"), 0u) << run.note;
  EXPECT_EQ(sound_ticks(run), 4u);
  EXPECT_EQ(run.entries[4].record.has_measurement, 0u);
  const RecordedRun refused = read([&](Logger& log) {
    tick(log, 1, 1);
    log.command(1, 20000);  // the guard refused a measurement that the logger did not hear
    log.telemetry(2, 20000, tiller_status_sensor_jump);
    tick(log, 3, 3);
  });
  EXPECT_EQ(refused.note.find("1 tick's measurement is missing: 1;"), 0u) << refused.note;
  const RecordedRun quiet = read([&](Logger& log) {
    tick(log, 1, 1);
    log.command(1, 20000);  // there was none
    log.telemetry(2, 20000, tiller_status_no_new_measurement);
    tick(log, 3, 3);
  });
  EXPECT_EQ(quiet.note, "");
}

TEST_F(Holes, TelemetryThatIsMissingIsOneOnlyWhereADeadlineCountsIterations) {
  const auto write = [&](std::int64_t late_us) {
    return [=](Logger& log) {
      for (std::uint32_t k = 1; k < 6; ++k) {
        log.measurement(k, 10000 * k);
        log.command(k, 10000 * k + late_us);
        if (k != 3) log.telemetry(k, 10000 * k + late_us);
      }
    };
  };
  EXPECT_EQ(read(write(300)).note, "") << "this robot's planner has no deadline";
  robot_->config.planner.deadline_us = 5000;
  EXPECT_EQ(read(write(0)).note, "") << "in lockstep the deadline is off";
  EXPECT_EQ(read(write(300)).note.find("1 tick's number of iterations is missing: 2; from tick 2 on"), 0u);
}

TEST_F(Holes, WhatAPlantInLockstepAskedTwiceIsOneTick) {
  const RecordedRun run = read([&](Logger& log) {
    for (std::uint32_t k = 1; k < 8; ++k) {
      log.measurement(k, 10000 * k);
      if (k % 2 == 0) log.measurement(k, 10000 * k);
      log.command(k, 10000 * k);
      log.telemetry(k, 10000 * k);
      if (k % 3 == 0) log.measurement(k, 10000 * k);
      if (k % 3 == 0) log.command(k, 10000 * k);
    }
  });
  EXPECT_EQ(run.note, "");
  ASSERT_EQ(run.entries.size(), 7u);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_EQ(run.entries[i].record.tick, i);
    EXPECT_EQ(run.entries[i].record.measurement.sequence, i + 1);
  }
}

TEST_F(Holes, WithoutTelemetryRepeatedAnswersAreNoTicksEither) {
  const RecordedRun run = read([&](Logger& log) {
    for (std::uint32_t k = 1; k < 4; ++k) {
      tick(log, k, 0);
      tick(log, k, 0);
    }
  });
  EXPECT_EQ(run.entries.size(), 3u);
  EXPECT_NE(run.note.find("no telemetry was logged"), std::string::npos) << run.note;
}

/// One reader: what replay takes for a repetition is one for `tiller gap` and `identify` too.
TEST_F(Holes, ReplayAndLearningSayTheSameOfALog) {
  const auto learn = [&] {
    Log log;
    std::string error;
    const bool good = read_any_log(folder_ / "logger.lcm", *robot_, log, error);
    EXPECT_EQ(good, error.empty());
    return std::make_pair(log, error);
  };
  const RecordedRun again = read([&](Logger& log) {
    for (std::uint32_t k = 1; k <= 30; ++k) {
      tick(log, k, k);
      if (k % 10 == 0) tick(log, k, k);  // the plant in lockstep asked again
    }
  });
  EXPECT_EQ(error_, "");
  EXPECT_EQ(again.entries.size(), 30u);
  const auto [log, error] = learn();
  EXPECT_EQ(error, "");
  ASSERT_EQ(log.rows(), 30u);
  for (std::size_t row = 0; row < 30; ++row) {
    EXPECT_EQ(log.state[robot_->config.measured_state[0]][row], again.entries[row].record.measurement.value[0]);
    EXPECT_EQ(log.input[0][row], again.entries[row].record.command.value[0]);
  }
  (void)read([&](Logger& out) {
    for (std::uint32_t k = 1; k <= 30; ++k) {
      tick(out, k, k);
      out.measurement(k, 10000 * k, 1.0);  // another plant on the channel
    }
  });
  for (const std::string& told : {error_, learn().second})
    EXPECT_NE(told.find("30 messages repeat the stamp and the sequence"), std::string::npos) << told;
}

TEST_F(Holes, LearningLeavesOutASecondRunAndWhatWasOvertaken) {
  (void)read([&](Logger& log) {
    for (std::uint32_t k = 1; k <= 30; ++k) {
      if (k == 20) log.measurement(18, 180001);  // after number 19
      tick(log, k, k);
    }
    for (std::uint32_t k = 0; k < 10; ++k) tick(log, k, k + 1);
  });
  Log log;
  std::string error;
  ASSERT_TRUE(read_any_log(folder_ / "logger.lcm", *robot_, log, error)) << error;
  EXPECT_EQ(log.rows(), 30u);
  EXPECT_EQ(log.note,
            "1 measurements that later ones overtook are left out; a second run begins in it, which is left "
            "out");
}

TEST_F(Holes, OtherThingsThatAreMissingAreToldToo) {
  const RecordedRun second = read([&](Logger& log) {
    for (std::uint32_t k = 1; k < 8; ++k) tick(log, k, k % 4 + 1);
  });
  EXPECT_NE(second.note.find("a second run begins in it"), std::string::npos) << second.note;
  (void)read([&](Logger& log) { log.measurement(1, 1); });
  EXPECT_NE(error_.find("no messages on channel TILLER_COMMAND"), std::string::npos) << error_;
}

}  // namespace
}  // namespace tiller::tools
