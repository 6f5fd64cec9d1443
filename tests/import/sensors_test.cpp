// Sensors of an MJCF: what the robot file measures, the entries for logs against what MuJoCo's sensors read, which is
// stored (mjcf_test.py --write), and what is left out by name.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "sensor_arm.hpp"  // as imported
#include "tools/import/robot_writer.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::json;
using Arm = SensorArm<double>;
constexpr int kJoints = 4;
using Numbers = std::vector<double>;

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
Json arm() { return Json::parse(text_of(TILLER_SENSORS ".json")); }
std::string robot_file() { return text_of(TILLER_SENSORS_ROBOT); }
void expect_in(const std::string& all, const std::string& part) { EXPECT_NE(all.find(part), std::string::npos) << all; }

/// An entry of the robot file's list, by its line.
struct Entry {
  std::string column, of;
  int derivative = 0;
  bool accelerometer = false;
  double sd = 0.0, zero = 0.0;
};
std::vector<Entry> entries() {
  std::vector<Entry> out;
  const std::string file = robot_file(), head = "#   { column = \"";
  for (std::size_t at = file.find(head); at != std::string::npos; at = file.find(head, at + 1)) {
    const std::string line = file.substr(at, file.find('\n', at) - at);
    const auto word = [&](const std::string& key) {
      const std::size_t from = line.find(key + " = \"") + key.size() + 4;
      return line.substr(from, line.find('"', from) - from);
    };
    const auto number = [&](const std::string& key) {
      const std::size_t from = line.find(", " + key + " = ");
      return from == std::string::npos ? 0.0 : std::strtod(line.c_str() + from + key.size() + 5, nullptr);
    };
    out.push_back({word("column"), word("of"), static_cast<int>(number("derivative")),
                   line.find("accelerometer = true") != std::string::npos, number("sd"), number("zero")});
  }
  return out;
}

int output_of(const std::string& name) {
  for (int i = 0; i < Arm::Output::count; ++i)
    if (name == Arm::Output::names[i]) return i;
  ADD_FAILURE() << name;
  return 0;
}

/// A motion through a state of MuJoCo's, with its accelerations.
struct Motion {
  Numbers q, v, a;
  Numbers outputs(double t) const {
    double state[2 * kJoints];
    for (std::size_t j = 0; j < kJoints; ++j) {
      state[j] = q[j] + t * (v[j] + 0.5 * t * a[j]);
      state[kJoints + j] = v[j] + t * a[j];
    }
    Arm::State x;
    static_assert(sizeof x == sizeof state);
    std::memcpy(static_cast<void*>(&x), state, sizeof state);
    const Arm::Output y = Arm::outputs(x);
    Numbers out(Arm::Output::count);
    std::memcpy(out.data(), static_cast<const void*>(&y), sizeof y);
    return out;
  }
  double value(int output, int derivative) const {
    const auto at = static_cast<std::size_t>(output);
    if (derivative == 0) return outputs(0.0)[at];
    const auto second = [&](double h) { return (outputs(h)[at] - 2 * outputs(0.0)[at] + outputs(-h)[at]) / (h * h); };
    constexpr double kShort_s = 1e-5, kWide_s = 4e-4;
    if (derivative == 1) return (outputs(kShort_s)[at] - outputs(-kShort_s)[at]) / (2 * kShort_s);
    return (4 * second(0.5 * kWide_s) - second(kWide_s)) / 3;  // without the fourth derivative's share
  }
  /// Along the frame's own axis, without gravity's share: "imu_y_m" of the frame imu.
  double felt(const std::string& of) const {
    const std::string frame = of.substr(0, of.size() - 4);
    double sum = 0.0;
    for (const char axis : {'x', 'y', 'z'}) {
      const double along = value(output_of(frame + "_r" + axis + of[of.size() - 3]), 0);
      sum += along * (value(output_of(frame + "_" + axis + "_m"), 2) + (axis == 'z' ? 9.81 : 0.0));
    }
    return sum;
  }
};

TEST(Sensors, EntriesForLogsReadWhatMuJoCosSensorsDo) {
  const std::vector<Entry> all = entries();
  std::set<std::string> columns;
  for (const Entry& entry : all) columns.insert(entry.column);
  EXPECT_EQ(columns.size(), 8u * 3u) << "eight sensors of three values";
  const Json rows = Json::parse(text_of(TILLER_SENSORS "_readings.json"));
  ASSERT_GE(rows.size(), 20u);
  for (const Json& row : rows) {
    const Motion motion{row["q"].get<Numbers>(), row["v"].get<Numbers>(), row["a"].get<Numbers>()};
    for (const Entry& entry : all) {
      const double theirs = row["readings"].at(entry.column).get<double>();
      const double ours = entry.accelerometer ? motion.felt(entry.of)
                                              : motion.value(output_of(entry.of), entry.derivative) + entry.zero;
      // second differences over 2e-4 s of positions that are rounded at 1e-16 have 1e-8, first ones less
      const bool exact = entry.derivative == 0 && !entry.accelerometer;
      EXPECT_NEAR(ours, theirs, (exact ? 1e-11 : 1e-6) * std::max(1.0, std::fabs(theirs))) << entry.column;
    }
  }
}

TEST(Sensors, JointsWithSensorsAreMeasured) {
  expect_in(
      robot_file(),
      "[measurement]\n"
      "pan_rad = { sd = 0.001 }\n"
      "lift_rad = { sd = 0.0005 }   # the description states no noise\n"
      "reach_m = { sd = 0.0002 }\n"
      "lift_rad_s = { sd = 0.02 }\n"
      "reach_m_s = { sd = 0.014 }   # the description states no noise\n"
      "# the description has no sensor of swing, whose motion shows in the others' alone; an encoder: swing_rad = ");
  expect_in(robot_file(), "rates = true ");
  expect_in(robot_file(), "sensors.lift_rad_s = { sd = 0.01 }");
  expect_in(robot_file(), "column = \"accelerometer_z\", of = \"imu_z_m\", accelerometer = true, sd = 0.2");
}

/// What the import makes of a file's sensors.
struct Placed {
  ModelSensors sensors;
  std::vector<int> frames;
  std::string left_out;
};
Placed placed(const Json& json, std::size_t room = 64, const MechanismOptions& options = {}) {
  Description robot;
  Mechanism mechanism;
  std::vector<std::string> errors;
  EXPECT_TRUE(read_compiled_mjcf(json.dump(), "sensors.xml", robot, errors) &&
              build_mechanism(robot, options, mechanism, errors))
      << errors[0];
  Placed out;
  out.sensors = place_sensors(robot, name_model(mechanism), room, mechanism, out.frames);
  for (const std::string& what : mechanism.left_out) out.left_out += what + "\n";
  return out;
}

TEST(Sensors, WhatIsNotReadIsNamedWithItsReason) {
  const std::string told = placed(arm()).left_out;
  for (const char* part :
       {"sensor attitude (framequat): a rotation has two quaternions", "sensor relative (framepos): it is relative to",
        "sensor centre (framepos): it is attached to a body; put a site there",
        "sensor ball (framepos): its site 'toy' is no part of the robot", "sensor still (gyro): it stands still",
        "sensor wrist_force (force): it reads a force between two links", "sensor wrist_torque (torque): ",
        "sensor lift_current (actuatorfrc): it reads the force of a drive, which is the input",
        "sensor lift_torque (jointactfrc): ", "sensor pusher_length (actuatorpos): ", "sensor skin (touch): ",
        "sensor compass (magnetometer): "})
    expect_in(told, part);
  expect_in(robot_file(), "# - sensor wrist_force (force): ");
}

TEST(Sensors, ChangesOfTheFileShow) {
  const auto changed = [](const std::function<void(Json&)>& change) {
    Json json = arm();
    change(json);
    return json;
  };
  // nothing about joints: every position is measured, as of a file without sensors
  const Json none = changed([](Json& j) { j["sensors"] = Json::array(); });
  EXPECT_TRUE(placed(none).sensors.position_sd.empty());
  EXPECT_EQ(placed(none).left_out, "");
  EXPECT_TRUE(placed(changed([](Json& j) { j.erase("sensors"); })).sensors.position_sd.empty()) << "of an older import";

  expect_in(placed(changed([](Json& j) { j["sensors"][1]["target"] = "pan"; })).left_out,
            "sensor lift_encoder (jointpos): another one measures the same");
  expect_in(placed(changed([](Json& j) { j["sensors"][0]["delay"] = 0.01; })).left_out,
            "sensor pan_encoder: its cutoff and delay are not read");
  expect_in(placed(changed([](Json& j) { j["sensors"][0]["target"] = "toy_joint"; })).left_out,
            "sensor pan_encoder (jointpos): joint 'toy_joint' is no part of the robot");
  MechanismOptions held;
  held.held = {{"reach", 0.0}};
  expect_in(placed(arm(), 64, held).left_out,
            "sensor reach_scale (jointpos): joint 'reach' does not move in the model");
  expect_in(placed(changed([](Json& j) {
              j["equalities"].push_back({{"name", "belt"},
                                         {"type", "joint"},
                                         {"active", true},
                                         {"data", {0, 2, 0, 0, 0}},
                                         {"joints", {"lift", "pan"}}});
            })).left_out,
            "sensor lift_encoder (jointpos): joint 'lift' follows 'pan'");

  // a gyroscope and one frame fit, nothing else does
  const Placed tight = placed(arm(), 15);
  EXPECT_EQ(tight.sensors.motions.size(), 1u);
  EXPECT_EQ(tight.frames.size(), 1u);
  expect_in(tight.left_out, "sensor star_tracker (frameangvel): the model has no room for the outputs that it reads");
  expect_in(tight.left_out, "sensor camera (framepos): the model has no room");

  // no sensor can be of the joints of a base that moves: they stay measured
  MechanismOptions floating;
  floating.base = BaseKind::planar;
  const ModelSensors afloat = placed(arm(), 64, floating).sensors;
  EXPECT_EQ(afloat.position_sd[0], 0.0);
  EXPECT_TRUE(std::isnan(afloat.position_sd.back())) << "the swing";
}

}  // namespace
}  // namespace tiller::tools
