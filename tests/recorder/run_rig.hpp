#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <sstream>

#include "tools/logs/recorder.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {

constexpr const char* kArm = R"([model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { uniform = [0.4, 0.6] }
length_m = 0.4
damping_Nms = 0.01
[measurement]
angle_rad = { sd = 0.002 }
rate_rad_s = { sd = 0.02 }
[planner]
kind = "mppi"
horizon = 20
knots = 5
rollouts = 32
particles = 2
iterations = 1
noise_sd = { torque_Nm = 0.3 }
[posterior]
particles = 32
[cost]
state_weight = { angle_rad = 1.0 }
[limits]
torque_Nm = { low = -3, high = 3 }
)";

inline std::unique_ptr<RobotFile> arm() {
  std::string errors;
  auto robot = parse_robot_file(kArm, "arm.toml", errors);
  EXPECT_TRUE(robot) << errors;
  return robot;
}

/// The same, whose posterior looks for forces beyond the model.
inline std::unique_ptr<RobotFile> pushed_arm() {
  std::string text = kArm, errors;
  const std::string posterior = "[posterior]\n";
  text.insert(text.find(posterior) + posterior.size(), "disturbance = true\n");
  auto robot = parse_robot_file(text, "arm.toml", errors);
  EXPECT_TRUE(robot) << errors;
  return robot;
}

/// A tick with every kind of number that a log must bring back: thirds, the smallest and largest, NaN, infinity, -0.
inline LoggedTick odd_tick(std::uint64_t k) {
  const double inf = std::numeric_limits<double>::infinity();
  const double odd[] = {
      1.0 / 3.0 + static_cast<double>(k), 5e-324, -0.0, 1.7976931348623157e308, std::nan(""), -inf, inf,
      0.1 * static_cast<double>(k)};
  LoggedTick tick;
  tiller_record_t& r = tick.entry.record;
  r.tick = k;
  r.now_us = 1000000 + 10000 * static_cast<std::int64_t>(k);
  r.has_measurement = k % 5 != 4;
  if (r.has_measurement != 0) {
    r.measurement.stamp_us = r.now_us - 1500;
    r.measurement.sequence = static_cast<std::uint32_t>(4294967290u + k);  // wraps
    r.measurement.command_latency_us = 1700;
    r.measurement.value[0] = odd[k % 8];
    r.measurement.value[1] = odd[(k + 3) % 8];
  }
  r.command.stamp_us = r.now_us;
  // without a new one, that of the last one
  r.command.sequence = static_cast<std::uint32_t>(4294967290u + k - (r.has_measurement != 0 ? 0 : 1));
  r.command.state = tiller_state_active;
  r.command.plan_sequence = static_cast<std::uint32_t>(4294967280u + k);
  r.command.value[0] = std::sin(static_cast<double>(k));
  r.status = tiller_status_rate_limited;
  r.planner_iterations = 2;
  r.calls = k == 0 ? tiller_call_arm : tiller_call_prepare;
  r.plan_cost = inf;
  r.effective_samples = 31.7;
  r.noise_scale = 1.0 / 7.0;
  r.tick_ns = 123456;
  r.state_mean[0] = 0.1 + static_cast<double>(k);
  r.param_mean[0] = 0.512;
  r.param_sd[0] = 1e-17;
  tick.info.ticks = k + 1;
  tick.info.state = r.command.state;
  tick.time_s = 0.01 * static_cast<double>(k);
  return tick;
}

/// The same of a pushed arm.
inline LoggedTick pushed_tick(std::uint64_t k) {
  LoggedTick tick = odd_tick(k);
  tick.info.force_joints = 1;
  tick.info.touched = k % 3 == 1 ? 1 : 0;
  tick.info.force_mean[0] = -1.0 / (3.0 + static_cast<double>(k));
  tick.info.force_sd[0] = k == 0 ? 5e-324 : 1.0 / 7.0;
  take_news(tick.info, tick.entry);
  return tick;
}

inline bool same_double(double a, double b) {
  return std::isnan(a) ? std::isnan(b) : std::memcmp(&a, &b, sizeof a) == 0;
}

/// Everything that a replay needs, to the last bit.
inline void expect_same(const tiller_record_t& a, const tiller_record_t& b) {
  EXPECT_EQ(a.tick, b.tick);
  EXPECT_EQ(a.now_us, b.now_us);
  EXPECT_EQ(a.has_measurement, b.has_measurement);
  EXPECT_EQ(a.measurement.stamp_us, b.measurement.stamp_us);
  EXPECT_EQ(a.measurement.sequence, b.measurement.sequence);
  EXPECT_EQ(a.measurement.command_latency_us, b.measurement.command_latency_us);
  for (int i = 0; i < 2; ++i) EXPECT_PRED2(same_double, a.measurement.value[i], b.measurement.value[i]) << a.tick;
  EXPECT_EQ(a.command.stamp_us, b.command.stamp_us);
  EXPECT_EQ(a.command.sequence, b.command.sequence);
  EXPECT_EQ(a.command.state, b.command.state);
  EXPECT_EQ(a.command.plan_sequence, b.command.plan_sequence);
  EXPECT_PRED2(same_double, a.command.value[0], b.command.value[0]);
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.planner_iterations, b.planner_iterations);
  EXPECT_EQ(a.calls, b.calls);
  EXPECT_EQ(a.tick_ns, b.tick_ns);
  EXPECT_PRED2(same_double, a.plan_cost, b.plan_cost);
  EXPECT_PRED2(same_double, a.effective_samples, b.effective_samples);
  EXPECT_PRED2(same_double, a.noise_scale, b.noise_scale);
  EXPECT_PRED2(same_double, a.state_mean[0], b.state_mean[0]);
  EXPECT_PRED2(same_double, a.param_mean[0], b.param_mean[0]);
  EXPECT_PRED2(same_double, a.param_sd[0], b.param_sd[0]);
}

/// What the log tells of the forces, to the last bit.
inline void expect_same_forces(const RecordEntry& a, const RecordEntry& b) {
  EXPECT_EQ(a.force_joints, b.force_joints) << a.record.tick;
  EXPECT_EQ(a.touched, b.touched) << a.record.tick;
  EXPECT_PRED2(same_double, a.force_mean[0], b.force_mean[0]) << a.record.tick;
  EXPECT_PRED2(same_double, a.force_sd[0], b.force_sd[0]) << a.record.tick;
}

inline std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream bytes;
  bytes << file.rdbuf();
  return bytes.str();
}

class Folder {
 public:
  Folder() {
    std::string made = (std::filesystem::temp_directory_path() / "tiller-recorder-XXXXXX").string();
    EXPECT_NE(mkdtemp(made.data()), nullptr);
    path_ = made;
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

}  // namespace tiller::tools
