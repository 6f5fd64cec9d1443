// The ticks about an alarm: what a row's input is when commands take hold between measurements, and what is left out.

#include "tools/logs/alarm_window.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "read_all.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

class Window : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-window-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    robot_.names.measurements = {"angle_rad"};
    robot_.names.inputs = {"torque_Nm"};
    robot_.config.period_s = 0.01;
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path() const { return folder_ + "/window.csv"; }

  /// A tick at `now_us` with a measurement that is `age_us` old and whose command takes hold `late_us` after now.
  static tiller_record_t record(std::int64_t now_us, double angle_rad, double torque_Nm, std::int64_t age_us = 0,
                                std::uint32_t late_us = 0) {
    tiller_record_t r{};
    r.now_us = r.command.stamp_us = now_us;
    r.has_measurement = 1;
    r.measurement.stamp_us = now_us - age_us;
    r.measurement.command_latency_us = static_cast<std::uint32_t>(age_us) + late_us;
    r.measurement.value[0] = angle_rad;
    r.command.value[0] = torque_Nm;
    r.command.state = tiller_state_active;
    return r;
  }

  RobotFile robot_;
  std::string folder_;
};

TEST_F(Window, InLockstepARowHasTheCommandThatAnswersIt) {
  AlarmWindow window(robot_);
  window.begin(path(), 10.0);
  for (int i = 0; i < 4; ++i) window.add(record(500000 + 10000 * i, 0.1 * i, i));
  EXPECT_TRUE(window.close());
  // the last measurement waits for a successor that does not come: how long its command held is not known
  EXPECT_EQ(test::read_all(path()), "time_s,angle_rad,torque_Nm\n0.000000,0,0\n0.010000,0.1,1\n0.020000,0.2,2\n");
}

TEST_F(Window, CommandsThatTakeHoldLaterAreMixedByTime) {
  AlarmWindow window(robot_);
  window.begin(path(), 10.0);
  // sensors read 2 ms before the tick, commands take hold 1 ms after it: 3 of 10 ms are the old command's
  for (int i = 0; i < 4; ++i) window.add(record(500000 + 10000 * i, 0.0, 10.0 * i, 2000, 1000));
  (void)window.close();
  EXPECT_EQ(test::read_all(path()), "time_s,angle_rad,torque_Nm\n0.000000,0,0\n0.010000,0,7\n0.020000,0,17\n");
}

TEST_F(Window, TicksWithoutAMeasurementGiveTheirCommandToTheRowBefore) {
  AlarmWindow window(robot_);
  window.begin(path(), 10.0);
  window.add(record(0, 0.0, 1.0));
  tiller_record_t none = record(10000, 0.0, 5.0);
  none.has_measurement = 0;
  window.add(none);
  tiller_record_t bad = record(20000, 99.0, 9.0);
  bad.status = tiller_status_sensor_out_of_range;
  window.add(bad);
  window.add(record(40000, 0.2, 1.0));
  (void)window.close();
  EXPECT_EQ(test::read_all(path()), "time_s,angle_rad,torque_Nm\n0.000000,0,6\n") << "(1 + 5 + 9 + 9) / 4";
}

TEST_F(Window, EndsWhenItIsLongEnoughAndInSafe) {
  AlarmWindow window(robot_);
  window.begin(path(), 0.05);
  for (int i = 0; i < 20; ++i) window.add(record(10000 * i, 0.0, 0.0));
  EXPECT_FALSE(window.open());
  EXPECT_EQ(window.rows(), 5u);
  EXPECT_DOUBLE_EQ(window.seconds(), 0.05);

  AlarmWindow stopped(robot_);
  stopped.begin(path(), 10.0);
  stopped.add(record(0, 0.0, 0.0));
  stopped.add(record(10000, 0.0, 0.0));
  tiller_record_t safe = record(20000, 0.0, 0.0);
  safe.command.state = tiller_state_safe;
  stopped.add(safe);
  EXPECT_FALSE(stopped.open());
  EXPECT_EQ(stopped.rows(), 1u);
}

TEST_F(Window, RingHoldsTheTimeAskedForUpToWhatARobotFileMayAsk) {
  EXPECT_EQ(AlarmWindow::ring_ticks(robot_, 20.0), 2000u);
  EXPECT_EQ(AlarmWindow::ring_ticks(robot_, 20.001), 2001u);
  EXPECT_EQ(AlarmWindow::ring_ticks(robot_, 1e6), 65536u);
}

}  // namespace
}  // namespace tiller::tools
