// What `tiller explain` says of runs in which one thing was broken on purpose.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>

#include "episodes_rig.hpp"
#include "tools/explain/explain.hpp"
#include "tools/explain/remedies.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/run/run_loop.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;
using Break = std::function<void(int tick, Sensed& sensed)>;

/// The simulated plant behind a cable on which `how` has a hand.
class Broken : public Link {
 public:
  Broken(Link& link, Break how) : link_(link), how_(std::move(how)) {}
  Sensed wait(const volatile std::sig_atomic_t& stop) override {
    Sensed sensed = link_.wait(stop);
    how_(tick_++, sensed);
    return sensed;
  }
  tiller_status_t send(const tiller_command_t& command) override { return link_.send(command); }
  bool truth(double* state) const override { return link_.truth(state); }

 private:
  Link& link_;
  Break how_;
  int tick_ = 0;
};

class Explain : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-explain-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    robot_ = test::small_robot();
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// A second of the robot with the broken cable, logged as CSV, MCAP, LCM log and record.
  void run(const Break& how) {
    std::vector<double> ignored;
    std::string error;
    test::Plants plants;
    Link* link = plants.open()(robot_, ignored, error);
    ASSERT_NE(link, nullptr) << error;
    Broken broken(*link, how);
    RunOptions options;
    options.seconds = 1;
    options.quiet = true;
    options.files.log = folder_ + "/run.csv";
    options.files.records = {folder_ + "/run.mcap", folder_ + "/run.lcm", folder_ + "/run.rec"};
    (void)run_robot(robot_, broken, options);
  }

  std::string explained(const std::string& name) {
    RecordedRun run;
    std::string error;
    EXPECT_TRUE(read_recorded_run(folder_ + "/" + name, robot_, run, error)) << error;
    const std::string text = explain_run(robot_, run, name, error);
    EXPECT_NE(text, "") << error;
    return text;
  }

  /// Every format tells all of it.
  void expect_everywhere(const std::vector<std::string>& parts) {
    for (const char* name : {"run.csv", "run.mcap", "run.lcm", "run.rec"}) {
      const std::string text = explained(name);
      for (const std::string& part : parts) EXPECT_NE(text.find(part), std::string::npos) << part << " in\n" << text;
    }
  }

  std::string folder_;
  RobotFile robot_;
};

TEST_F(Explain, AHealthyRunHasNothingToTell) {
  run([](int, Sensed&) {});
  expect_everywhere({"50 ticks in 0.98 s: 50 ACTIVE", "Nothing happened"});
  EXPECT_EQ(explained("run.csv").find("Next:"), std::string::npos) << explained("run.csv");
}

TEST_F(Explain, ACutCableIsSilence) {
  robot_.config.safety.sensor_timeout_s = 0.1;
  run([](int tick, Sensed& sensed) { sensed.fresh = sensed.fresh && tick < 20; });
  expect_everywhere({"ACTIVE", "SAFE", "no_new_measurement", "0.50 s (tick 25", "to the end", "sensor_stale",
                     "The last reading was taken in 0.12 s before, at 0.38 s (tick 19",
                     "[safety] sensor_timeout_s = 0.1", "check the cable"});
  const std::string csv = explained("run.csv");
  EXPECT_NE(csv.find("0.50 s (tick 25, line 27)"), std::string::npos) << "with the line of the file:\n" << csv;
  std::ifstream file(folder_ + "/run.csv");
  std::string line;
  for (int i = 0; i < 27; ++i) std::getline(file, line);
  EXPECT_NE(line.find(",SAFE,sensor_stale,"), std::string::npos) << line;
}

TEST_F(Explain, OneSensorThatDiesIsNamed) {
  run([](int tick, Sensed& sensed) {
    if (tick >= 20) sensed.measurement.value[1] = std::numeric_limits<double>::quiet_NaN();
  });
  expect_everywhere({"0.40 s (tick 20", "angle_rad was NaN; the rest of the reading was taken in",
                     "Readings came without angle_rad (NaN) for longer than [safety] sensor_timeout_s = 0.1"});
}

TEST_F(Explain, ReadingsOfNothingAreRefused) {
  robot_.config.safety.bad_ticks_to_safe = 3;
  run([](int tick, Sensed& sensed) {
    if (tick >= 20)
      sensed.measurement.value[0] = sensed.measurement.value[1] = std::numeric_limits<double>::quiet_NaN();
  });
  expect_everywhere({"sensor_not_finite", "position_m, angle_rad was NaN", "the plan before went on",
                     "reading number 3 in a row that was refused; [safety] bad_ticks_to_safe = 3"});
}

TEST_F(Explain, AJumpAndAValueOutOfRangeNameTheirLimits) {
  Config& config = robot_.config;
  config.measurement_rate_per_s[0] = 10;
  config.measurement_low[0] = -3;
  config.measurement_high[0] = 3;
  run([](int tick, Sensed& sensed) {
    if (tick == 20) sensed.measurement.value[0] = 2.5;
    if (tick == 30) sensed.measurement.value[0] = -4;
  });
  expect_everywhere({"0.40 s (tick 20", "sensor_jump", "position_m went from ", "to 2.5 m in 0.02 s",
                     "[measurement] position_m rate_per_s = 10", "0.60 s (tick 30", "sensor_out_of_range",
                     "position_m read -4 m, below [measurement] position_m low = -3"});
}

TEST_F(Explain, ARateLimitThatBindsIsARemarkWithItsShare) {
  robot_.config.safety.input_rate_per_s[0] = 20;  // 0.4 N a period, of 40 N
  run([](int, Sensed&) {});
  expect_everywhere({"Nothing happened", "force_N changed as fast as it may in ", "[limits] force_N rate_per_s = 20"});
}

TEST_F(Explain, TheHostsStopIsTheHosts) {
  run([](int tick, Sensed& sensed) {
    if (tick == 20) sensed.fault = tiller_status_actuator_fault;
  });
  expect_everywhere(
      {"0.40 s (tick 20", "actuator_fault", "The host stopped it by tiller_stop", "docs/evidence/faults.md"});
}

TEST_F(Explain, TicksThatAreLongerThanTheirDeadlineAreCounted) {
  run([](int, Sensed&) {});
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_recorded_run(folder_ + "/run.csv", robot_, run, error)) << error;
  EXPECT_EQ(run.deadline_us, 0) << "as the CSV says";
  EXPECT_GT(run.entries[0].record.tick_ns, 0);
  for (std::size_t i = 0; i < run.entries.size(); ++i)
    run.entries[i].record.tick_ns = i == 20 || i == 30 ? 9000000 : 1000;
  EXPECT_NE(explain_run(robot_, run, "run.csv", error).find("Nothing happened"), std::string::npos);
  run.deadline_us = 8000;
  const std::string text = explain_run(robot_, run, "run.csv", error);
  EXPECT_NE(text.find("0.40 s (tick 20, line 22), and 1 time more to 0.60 s"), std::string::npos) << text;
  EXPECT_NE(text.find("2 ticks in all: the tick took longer than its deadline"), std::string::npos) << text;
  EXPECT_NE(text.find("The longest took 9 ms; [planner] deadline_us = 8000, and the period is 20 ms"),
            std::string::npos)
      << text;
}

/// A deadline that no tick keeps, whatever the machine is.
TEST_F(Explain, APlannerWithoutTimeIsLateAndThenHolds) {
  robot_.config.planner.deadline_us = 1;
  robot_.config.safety.hold_ticks_to_safe = 10;
  run([](int, Sensed&) {});
  expect_everywhere({"deadline_missed", "The plan got 0 of 1 iterations", "[planner] deadline_us = 1", "It held",
                     "halve [planner] rollouts", "HOLD had lasted for [safety] hold_ticks_to_safe = 10 ticks"});
}

TEST_F(Explain, ACommandThatTheGateCutsNamesItsLimits) {
  run([](int, Sensed&) {});
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_recorded_run(folder_ + "/run.rec", robot_, run, error)) << error;
  for (std::size_t i = 10; i < 13; ++i) run.entries[i].record.status = tiller_status_command_limited;
  const std::string text = explain_run(robot_, run, "run.rec", error);
  EXPECT_NE(text.find("0.20 s (tick 10), for 3 ticks: command_limited"), std::string::npos) << text;
  EXPECT_NE(text.find("The gate clipped the command"), std::string::npos) << text;
  EXPECT_NE(text.find("in [-20, 20]"), std::string::npos) << text;
}

TEST_F(Explain, ALogThatTellsNoStatesIsRefused) {
  std::ofstream other(folder_ + "/other.csv");
  other << "time_s,position_m,angle_rad,force_N\n";
  for (int i = 0; i < 30; ++i) other << 0.02 * i << "," << 0.01 * i << ",0,0\n";
  other.close();
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_recorded_run(folder_ + "/other.csv", robot_, run, error)) << error;
  EXPECT_EQ(explain_run(robot_, run, "other.csv", error), "");
  EXPECT_NE(error.find("does not tell the controller's states"), std::string::npos) << error;
}

TEST(Remedies, EveryFaultAndLimitHasOne) {
#define TILLER_STATUS(code, name, band, text)                                      \
  if (code >= 100) {                                                               \
    EXPECT_GT(std::string(remedy_for(tiller_status_##name)).size(), 20u) << #name; \
  }
#include "tiller/status.def"
#undef TILLER_STATUS
}

}  // namespace
}  // namespace tiller::tools
