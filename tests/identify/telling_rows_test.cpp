// Long logs are cut to the pieces that tell most: short ones stay as they are, bursts are found, half is spread evenly.
#include "tools/logs/telling_rows.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "core/rng.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools {
namespace {

constexpr double kPeriod_s = 0.02, kSensor_rad = 0.002;

tiller_config_t pendulum_config() {
  tiller_config_t config;
  tiller_config_default(&config, tiller_find_model("pendulum"));
  config.period_s = kPeriod_s;
  config.measurement_count = 1;
  config.measured_state[0] = 0;
  config.measurement_sd[0] = kSensor_rad;
  return config;
}

constexpr double kBurst_s = 20, kEvery_s = 1000, kAt_s = 490;

bool is_burst(double t) {
  return t >= 0 && std::fmod(t, kEvery_s) >= kAt_s && std::fmod(t, kEvery_s) < kAt_s + kBurst_s;
}

// A machine that rests but for a burst of motion in 2 % of the time. Its angle is a filtered command: no model is
// asked.
Log resting_log(double seconds, std::uint64_t seed) {
  Log log;
  log.path = "rests.csv";
  log.state.resize(2);
  log.input.resize(1);
  Rng rng(seed, kRngSelect, 0);
  double angle = 0, rate = 0;
  for (int i = 0; i * kPeriod_s < seconds; ++i) {
    const double t = i * kPeriod_s;
    const double command = is_burst(t) ? 1.2 * std::sin(2.2 * t) + 0.9 * std::sin(5.2 * t) : 0;
    rate += kPeriod_s * (20 * (command - angle) - 2 * rate);
    angle += kPeriod_s * rate;
    log.line.push_back(i + 2);
    log.time_s.push_back(t);
    log.state[0].push_back(angle + kSensor_rad * rng.normal());
    log.input[0].push_back(command);
  }
  return log;
}

double burst_seconds(const std::vector<Log>& logs) {
  double sum = 0;
  for (const Log& log : logs)
    for (const double t : log.time_s) sum += is_burst(t) ? kPeriod_s : 0;
  return sum;
}

TEST(TellingRows, ShortLogsStayAsTheyAre) {
  std::vector<Log> logs = {resting_log(100, 1), resting_log(200, 2)};
  const std::vector<Log> before = logs;
  const UsedRows used = keep_telling_rows(logs, pendulum_config(), 15000);
  EXPECT_TRUE(used.everything());
  EXPECT_EQ(used.text(), "");
  ASSERT_EQ(logs.size(), 2u);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(logs[i].state[0], before[i].state[0]);
}

TEST(TellingRows, NoBoundTakesAll) {
  std::vector<Log> logs = {resting_log(400, 1)};
  const std::size_t rows = logs[0].rows();
  EXPECT_TRUE(keep_telling_rows(logs, pendulum_config(), 0).everything());
  EXPECT_EQ(logs[0].rows(), rows);
}

TEST(TellingRows, BurstsAreFound) {
  std::vector<Log> logs = {resting_log(6000, 3)};                           // six bursts, 120 s together
  const UsedRows used = keep_telling_rows(logs, pendulum_config(), 20000);  // 400 s
  EXPECT_NEAR(used.used_s, 400, 10);
  EXPECT_NEAR(used.all_s, 6000, 1);
  EXPECT_NE(used.text().find(" s of 6000 s"), std::string::npos) << used.text();
  EXPECT_NE(used.text().find("--most-steps 0"), std::string::npos);
  // an even choice has 8 s of them; the other half has room for all 120 s, in pieces that burst and rest share
  EXPECT_GT(burst_seconds(logs), 110);
}

TEST(TellingRows, HalfIsSpreadOverTheWholeTime) {
  std::vector<Log> logs = {resting_log(6000, 4)};
  keep_telling_rows(logs, pendulum_config(), 20000);
  double seconds[10] = {};
  for (const double t : logs[0].time_s) seconds[static_cast<int>(t / 600)] += kPeriod_s;
  for (const double s : seconds) EXPECT_GT(s, 15.5);  // two whole pieces of the 2.5 that an even half has there
}

TEST(TellingRows, EvenlyLooksAtNothing) {
  std::vector<Log> logs = {resting_log(6000, 5)};
  const UsedRows used = keep_telling_rows(logs, pendulum_config(), 20000, true);
  EXPECT_NE(used.text().find("evenly over the logs"), std::string::npos);
  EXPECT_LT(burst_seconds(logs), 40);
}

TEST(TellingRows, WhatIsLeftOutIsAGap) {
  std::vector<Log> logs = {resting_log(6000, 6)};
  keep_telling_rows(logs, pendulum_config(), 20000);
  const Log whole = resting_log(6000, 6);
  const tiller_config_t config = pendulum_config();
  std::size_t steps = 0;
  for (const Stretch& stretch : make_stretches(logs[0], LogMap(), config)) {
    const auto row = static_cast<std::size_t>(std::lround(stretch.first_time_s / kPeriod_s));
    EXPECT_EQ(stretch.start[0], whole.state[0][row]);
    for (std::size_t i = 0; i < stretch.steps.size(); ++i) {
      EXPECT_NEAR(stretch.steps[i].period_s, kPeriod_s, 1e-9);
      EXPECT_EQ(stretch.steps[i].measured[0], whole.state[0][row + i + 1]);
      ++steps;
    }
  }
  EXPECT_NEAR(static_cast<double>(steps), 20000, 500);
}

TEST(TellingRows, ShortRunsAndMissingCellsArePiecesToo) {
  std::vector<Log> logs;
  for (std::uint64_t k = 0; k < 200; ++k) logs.push_back(resting_log(5, k));
  for (Log& log : logs)
    for (std::size_t i = 0; i < log.rows(); i += 3) log.state[0][i] = NAN;
  const UsedRows used = keep_telling_rows(logs, pendulum_config(), 5000);
  EXPECT_NEAR(used.used_s, 100, 60);
  for (const Log& log : logs) EXPECT_EQ(log.rows(), 250u);  // whole runs
}

TEST(TellingRows, ASensorThatSaysNothingIsNoReasonToStop) {
  std::vector<Log> logs = {resting_log(1000, 7)};
  logs[0].state[0].assign(logs[0].rows(), NAN);
  const UsedRows used = keep_telling_rows(logs, pendulum_config(), 5000);
  EXPECT_NEAR(used.used_s, 100, 10);
}

TEST(TellingRows, TheSameLogsGiveTheSameRows) {
  std::vector<Log> a = {resting_log(3000, 8)}, b = a;
  keep_telling_rows(a, pendulum_config(), 10000);
  keep_telling_rows(b, pendulum_config(), 10000);
  EXPECT_EQ(a[0].line, b[0].line);
}

}  // namespace
}  // namespace tiller::tools
