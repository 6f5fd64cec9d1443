// Who arms: from a decision to a motion, and what is none.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "tools/logs/identify_log.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/replay/replay.hpp"
#include "tools/run/arm_keys.hpp"
#include "tools/run/run_loop.hpp"
#include "tools/run/sensor_view.hpp"

namespace tiller::tools {
namespace {

using Script = std::vector<std::pair<int, ArmRequest>>;  // decided before the tick of that number

class Scripted : public ArmSource {
 public:
  explicit Scripted(const int& tick, Script script) : tick_(tick), script_(std::move(script)) {}
  ArmRequest poll() override {
    ArmRequest decided = ArmRequest::none;
    while (next_ < script_.size() && script_[next_].first <= tick_) decided = script_[next_++].second;
    return decided;
  }
  std::string help() const override { return "a script"; }

 private:
  const int& tick_;
  Script script_;
  std::size_t next_ = 0;
};

/// A pendulum that a hand swings, whose drive takes three ticks to get ready. Counts what it may and what it does.
class Driven : public Link {
 public:
  explicit Driven(double period_s) : period_us_(std::llround(1e6 * period_s)) {}
  Sensed wait(const volatile std::sig_atomic_t&) override {
    ++tick_;
    Sensed s;
    s.now_us = 1000000 + period_us_ * tick_;
    s.fresh = tick_ < silent_from_;
    s.measurement.stamp_us = s.now_us;
    s.measurement.sequence = static_cast<std::uint32_t>(tick_);
    s.measurement.value[0] = 0.3 * std::sin(0.2 * tick_);
    return s;
  }
  tiller_status_t send(const tiller_command_t& c) override {
    const bool moves = c.state == tiller_state_active || c.state == tiller_state_hold;
    if (moves && first_moved_ == 0) first_moved_ = tick_;
    if (moves) last_moved_ = tick_;
    if (!moves) other_ = other_ || c.value[0] != 0.0;
    return tiller_status_ok;
  }
  bool truth(double*) const override { return false; }
  void permit() override { permitted_ = permitted_ == 0 ? tick_ : permitted_; }
  void prepare(bool on) override {
    prepared_ = on;
    ready_ = tick_ + 3;
  }
  bool is_ready() const override { return prepared_ && tick_ >= ready_; }

  std::int64_t period_us_;
  int tick_ = 0, silent_from_ = 1000000, ready_ = 0, permitted_ = 0, first_moved_ = 0, last_moved_ = 0;
  bool prepared_ = false, other_ = false;
};

class ArmingRun : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string errors;
    robot_ = read_robot_file(TILLER_TEST_ROBOTS "/pendulum.toml", errors);
    ASSERT_NE(robot_, nullptr) << errors;
    robot_->config.planner.rollouts = 16;
    robot_->config.planner.iterations = 1;
    robot_->config.planner.deadline_us = 0;
    robot_->config.posterior.particles = 32;
    robot_->config.posterior.moves_per_tick = 8;
    // what the hand does is no motion of the model's: here nothing is doubted for it
    robot_->config.safety.frozen_ticks = 0;
    robot_->config.measurement_sd[0] = 1.0;
    options_.arm_at_once = false;
    options_.quiet = true;
    options_.seconds = 60 * robot_->config.period_s;
    link_ = std::make_unique<Driven>(robot_->config.period_s);
  }
  RunResult run(Script script) {
    Scripted source(link_->tick_, std::move(script));
    options_.arm_sources = {&source};
    testing::internal::CaptureStderr();
    const RunResult result = run_robot(*robot_, *link_, options_);
    told_ = testing::internal::GetCapturedStderr();
    return result;
  }
  bool told(const char* what) const { return told_.find(what) != std::string::npos; }

  std::unique_ptr<RobotFile> robot_;
  std::unique_ptr<Driven> link_;
  RunOptions options_;
  std::string told_;
};

TEST_F(ArmingRun, NobodyArmsAndNothingMovesOrIsLearnt) {
  const RunResult r = run({});
  EXPECT_EQ(r.exit_code, 0);
  EXPECT_EQ(r.ticks, 60u) << "--seconds count from the first measurement";
  EXPECT_EQ(link_->first_moved_, 0);
  EXPECT_FALSE(link_->other_);
  EXPECT_EQ(link_->permitted_, 0) << "drives were let on";
  EXPECT_FALSE(link_->prepared_);
  EXPECT_TRUE(told("STANDBY: nothing moves. To arm: a script")) << told_;
  EXPECT_TRUE(told("never armed")) << told_;
  EXPECT_EQ(r.transitions, 0u);
  const RunResult again = [&] {
    link_ = std::make_unique<Driven>(robot_->config.period_s);
    options_.seconds = 2 * robot_->config.period_s;
    return run({});
  }();
  for (std::uint32_t i = 0; i < robot_->config.param_count; ++i)
    EXPECT_EQ(r.info.param_mean[i], again.info.param_mean[i]) << "a hand taught parameter " << i;
}

TEST_F(ArmingRun, ADecisionGetsTheDrivesReadyAndThenMoves) {
  const RunResult r = run({{20, ArmRequest::arm}, {40, ArmRequest::disarm}, {50, ArmRequest::arm}});
  EXPECT_EQ(r.exit_code, 0);
  EXPECT_EQ(link_->permitted_, 20);
  EXPECT_EQ(link_->first_moved_, 23) << "the tick in which the drives were ready";
  EXPECT_EQ(r.ticks, 52u + 60u) << "the task begins when it is armed again, and lasts --seconds";
  EXPECT_FALSE(link_->other_) << "the safe command in all other states";
  EXPECT_FALSE(link_->prepared_) << "drives are left off";
  EXPECT_TRUE(told("armed") && told("disarmed: STANDBY")) << told_;
}

TEST_F(ArmingRun, DisarmedWhileDrivesGetReadyItDoesNotMove) {
  (void)run({{20, ArmRequest::arm}, {21, ArmRequest::disarm}});
  EXPECT_EQ(link_->first_moved_, 0);
  EXPECT_FALSE(link_->prepared_);
}

TEST_F(ArmingRun, ADecisionBeforeTheFirstMeasurementIsNone) {
  (void)run({{0, ArmRequest::arm}});
  EXPECT_EQ(link_->first_moved_, 0);
  EXPECT_TRUE(told("before the first measurement does not arm")) << told_;
}

TEST_F(ArmingRun, StaleSensorsInStandbyAreSafeAndNobodyArms) {
  link_->silent_from_ = 15;
  const int stale = 15 + static_cast<int>(robot_->config.safety.sensor_timeout_s / robot_->config.period_s) + 3;
  options_.seconds = 0;
  const RunResult r = run({{stale, ArmRequest::arm}});
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_EQ(r.info.first_fault, static_cast<std::uint32_t>(tiller_status_sensor_stale));
  EXPECT_EQ(link_->first_moved_, 0);
  EXPECT_EQ(link_->permitted_, 0);
  EXPECT_TRUE(told("not armed: SAFE")) << told_;
}

TEST_F(ArmingRun, AtOnceIsAsSoonAsTheDrivesAreReady) {
  options_.arm_at_once = true;
  const RunResult r = run({});
  EXPECT_EQ(link_->first_moved_, 4);
  EXPECT_EQ(r.ticks, 60u);
  EXPECT_EQ(told_, "");
}

TEST_F(ArmingRun, GoalsCountFromWhereTheTaskBegins) {
  const double period_s = robot_->config.period_s;
  options_.goals = {{0.0, {1.0, 0.0}, {}}, {30 * period_s, {2.0, 0.0}, {}}};
  options_.files.log = ::testing::TempDir() + "/goals.csv";
  (void)run({{40, ArmRequest::arm}});
  std::ifstream log(options_.files.log);
  std::vector<Words> rows;
  for (std::string line; std::getline(log, line);) {
    std::istringstream cells(line);
    rows.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(cell);
  }
  ASSERT_GT(rows.size(), 80u);
  const auto cell = [&](std::size_t row, const std::string& name) {
    const std::size_t at = static_cast<std::size_t>(std::find(rows[0].begin(), rows[0].end(), name) - rows[0].begin());
    return at < rows[row].size() ? std::strtod(rows[row][at].c_str(), nullptr) : std::nan("");
  };
  const double own = robot_->config.cost.target[0];
  EXPECT_NEAR(cell(30, "goal.angle_rad"), own, 1e-9) << "the goal of time 0 waits for the task";
  EXPECT_NEAR(cell(50, "goal.angle_rad"), 1.0, 1e-9);
  EXPECT_NEAR(cell(80, "goal.angle_rad"), 2.0, 1e-9);
}

TEST_F(ArmingRun, RecordsReplayToTheLastBitAndLogsTeachFromTheMotionOn) {
  options_.files.records = {::testing::TempDir() + "/standby.mcap", ::testing::TempDir() + "/standby.lcm"};
  options_.files.log = ::testing::TempDir() + "/standby.csv";
  const RunResult r = run({{30, ArmRequest::arm}, {60, ArmRequest::disarm}, {70, ArmRequest::arm}});
  std::string error;
  for (const std::string& path : {options_.files.records[0], options_.files.records[1], options_.files.log}) {
    RecordedRun recorded;
    ASSERT_TRUE(read_recorded_run(path, *robot_, recorded, error)) << error;
    ReplayResult replayed;
    ASSERT_TRUE(replay_through_file(*robot_, recorded, {}, replayed, error)) << error;
    EXPECT_EQ(replayed.ticks, r.ticks);
    EXPECT_EQ(replayed.different, 0u) << divergence_text(*robot_, recorded, replayed);
    EXPECT_FALSE(replayed.first_estimate.found);
  }
  Log log;
  ASSERT_TRUE(read_log(options_.files.log, robot_->log, *robot_->config.model, {0}, log, error)) << error;
  EXPECT_EQ(log.rows(), r.ticks - 32) << "ticks 1 to 32 were STANDBY: the drives get ready for three of them";
}

TEST(ArmKeys, OneKeyArmsAndAnyStops) {
  const auto typed = [](const std::string& keys) { return decide(keys.data(), keys.size()); };
  EXPECT_EQ(typed("a"), ArmRequest::arm);
  EXPECT_EQ(typed("A"), ArmRequest::none);
  EXPECT_EQ(typed("aa"), ArmRequest::none) << "pasted, or held: not one decision";
  EXPECT_EQ(typed("tiller run\n"), ArmRequest::disarm) << "a space stops, whatever it is among";
  EXPECT_EQ(typed("\033[a"), ArmRequest::none) << "a cursor key";
  EXPECT_EQ(typed("d"), ArmRequest::disarm);
  EXPECT_EQ(typed(" "), ArmRequest::disarm);
  EXPECT_EQ(typed("ad"), ArmRequest::disarm);
  EXPECT_EQ(typed(""), ArmRequest::none);
}

TEST(SensorView, ShowsSignUnitRateAndWhatStandsStill) {
  std::string errors;
  const auto robot = read_robot_file(TILLER_TEST_ROBOTS "/pendulum.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  SensorView view(*robot);
  tiller_measurement_t m{};
  for (int k = 0; k <= 50; ++k) {  // -0.5 rad/s across the end of the turn
    m.stamp_us = 20000 * k;
    m.value[0] = std::remainder(3.3 - 0.01 * k, 2 * M_PI);
    view.take(m);
  }
  EXPECT_NE(view.line().find("angle_rad +2.8000 rad  -0.500 rad/s"), std::string::npos) << view.line();
  EXPECT_EQ(view.line().find("unchanged"), std::string::npos);
  for (int k = 51; k <= 180; ++k) {
    m.stamp_us = 20000 * k;
    view.take(m);
  }
  EXPECT_NE(view.line().find("unchanged for 2 s"), std::string::npos) << view.line();
  EXPECT_NE(view.block().find("seen -3.1"), std::string::npos) << view.block();
}

}  // namespace
}  // namespace tiller::tools
