// An MJCF as MuJoCo compiles it: the equations that an import writes of it against MuJoCo's accelerations, which are
// stored beside it (mjcf_test.py --write), and what is refused or told.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "test_machine.hpp"  // as imported
#include "tools/description/description.hpp"
#include "tools/import/mechanism.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::json;
using Machine = TestMachine<double>;

constexpr int kJoints = 6;

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
Json machine() { return Json::parse(text_of(TILLER_MACHINE ".json")); }

template <class Into>
Into filled(const std::vector<double>& values) {
  Into into;
  EXPECT_EQ(sizeof into, values.size() * sizeof(double));
  std::memcpy(static_cast<void*>(&into), values.data(), sizeof into);
  return into;
}

void expect_mujocos(const char* key, double load_kg, double load_kgm2) {
  const Json rows = Json::parse(text_of(TILLER_MACHINE "_accelerations.json"));
  ASSERT_GE(rows.size(), 40u);
  for (const Json& row : rows) {
    auto state = row["q"].get<std::vector<double>>();
    for (const double v : row["v"].get<std::vector<double>>()) state.push_back(v);
    const Machine::State dx = Machine::dynamics(filled<Machine::State>(state), {},
                                                filled<Machine::Force>(row["force"].get<std::vector<double>>()),
                                                {1.2, -9.6, load_kg, load_kgm2});
    double ours[2 * kJoints], scale = 0.0;
    std::memcpy(ours, static_cast<const void*>(&dx), sizeof ours);
    const auto theirs = row[key].get<std::vector<double>>();
    for (const double a : theirs) scale = std::max(scale, std::fabs(a));
    for (int j = 0; j < kJoints; ++j) {
      EXPECT_NEAR(ours[kJoints + j], theirs[static_cast<std::size_t>(j)], 1e-11 * scale) << Machine::joints[j].name;
      EXPECT_EQ(ours[j], state[static_cast<std::size_t>(kJoints + j)]);
    }
  }
}

TEST(Mjcf, AccelerationsAreMuJoCos) { expect_mujocos("a", 0.0, 0.0); }
TEST(Mjcf, APayloadHangsAtASite) { expect_mujocos("a_loaded", 0.7, 0.004); }

std::string refusal(const Json& json, Description& robot, Mechanism& mechanism, const MechanismOptions& options = {}) {
  std::vector<std::string> errors;
  if (read_compiled_mjcf(json.dump(), "machine.xml", robot, errors))
    (void)build_mechanism(robot, options, mechanism, errors);
  std::string all;
  for (const std::string& error : errors) all += error + "\n";
  return all;
}
std::string refusal(const Json& json, const MechanismOptions& options = {}) {
  Description robot;
  Mechanism mechanism;
  return refusal(json, robot, mechanism, options);
}
std::string told(const Json& json, const MechanismOptions& options = {}) {
  Description robot;
  Mechanism mechanism;
  EXPECT_EQ(refusal(json, robot, mechanism, options), "");
  std::string all;
  for (const std::string& note : mechanism.notes) all += note + "\n";
  for (const std::string& what : mechanism.left_out) all += what + "\n";
  return all;
}
void expect_in(const std::string& all, const std::string& part) { EXPECT_NE(all.find(part), std::string::npos) << all; }

const MovingBody& body_of(const Mechanism& mechanism, const std::string& joint) {
  for (const MovingBody& body : mechanism.bodies)
    if (body.joint == joint) return body;
  ADD_FAILURE() << joint;
  return mechanism.bodies[0];
}

TEST(Mjcf, BodiesHangOnTheWorldInTheEnd) {
  for (const int parent : {3, 2, 1000000, -1}) {  // in a circle: it did not end; beyond the list: it was read
    Json json = machine();
    json["bodies"][2]["parent"] = parent;
    if (parent == 3) json["bodies"][3]["parent"] = 2;
    expect_in(refusal(json), parent == 2 || parent == 3 ? "hangs on itself" : "cannot be read");
  }
  Json json = machine();
  json["joints"][0]["body"] = 1000000;
  expect_in(refusal(json), "cannot be read");
}

TEST(Mjcf, WhatActsAtAJointIsTaken) {
  Description robot;
  Mechanism mechanism;
  ASSERT_EQ(refusal(machine(), robot, mechanism), "");
  EXPECT_EQ(robot.name, "test machine");
  const MovingBody &lane = body_of(mechanism, "lane"), &pan = body_of(mechanism, "pan");
  const MovingBody &tip = body_of(mechanism, "tip"), &elbow = body_of(mechanism, "elbow");
  const MovingBody &grip = body_of(mechanism, "grip"), &wheel = body_of(mechanism, "wheel_joint");
  EXPECT_TRUE(lane.prismatic);
  EXPECT_EQ(lane.effort, 80.0) << "gear 40, control up to 2";
  EXPECT_EQ(pan.effort, 12.0) << "its force's limit is below its control's";
  EXPECT_EQ(elbow.effort, 9.0) << "a servo's force has its limit too";
  EXPECT_EQ(grip.effort, 5.0) << "two motors, one with gear 3";
  EXPECT_DOUBLE_EQ(grip.armature, 0.09) << "a motor's armature through gear 3";
  EXPECT_EQ(pan.armature, 0.02);
  EXPECT_EQ(pan.damping, 0.3);
  EXPECT_EQ(pan.friction, 0.2);
  EXPECT_EQ(tip.stiffness, 7.0);
  EXPECT_EQ(tip.rest, 0.3);
  EXPECT_FALSE(tip.actuated);
  EXPECT_TRUE(elbow.actuated);
  EXPECT_EQ(lane.low, -0.5);
  EXPECT_EQ(lane.high, 0.7);
  EXPECT_TRUE(wheel.wraps);
  EXPECT_FALSE(tip.wraps) << "its spring remembers the turns";
  const MovingBody& mirror = body_of(mechanism, "grip_mirror");
  EXPECT_EQ(mirror.mimic_ratio, 1.5);
  EXPECT_NEAR(mirror.mimic_offset, 0.02 + 0.005 - 1.5 * 0.01, 1e-15);
  EXPECT_EQ(pan.start, 0.5) << "the keyframe home";
  EXPECT_GE(mechanism.find_frame("rim"), 0);
  EXPECT_LT(mechanism.find_frame("toy"), 0);
  const std::string file = text_of(TILLER_MACHINE_ROBOT);
  expect_in(file, "kind = \"linear_spring\"\nport = \"tip\"\nstiffness_SI = 7\n");
  expect_in(file, "kind = \"constant_offset\"\nport = \"tip\"\nforce_SI = 2.1\n");
  expect_in(file, "gravity_x_m_s2 = 1.2\ngravity_z_m_s2 = -9.6\n");
  expect_in(file, "pan_rad = 0.5");
  const std::string notes = told(machine());
  expect_in(file, "# - position servo lifter: the law is not read");
  expect_in(told(machine()), "kind = \"position_servo\", stiffness_SI = 50, damping_SI = 0, limit_SI = 9");
  for (const char* part : {"free thing toy: ", "position servo lifter: ", "geared motors drive (40), jaw (3): ",
                           "puller (tendon cord): ", "tendon cord: "})
    expect_in(notes, part);
}

TEST(Mjcf, WhatHasNoEquationsHereIsRefusedOrTold) {
  const auto changed = [](const std::function<void(Json&)>& change) {
    Json json = machine();
    change(json);
    return json;
  };
  const Json ball = changed([](Json& j) { j["joints"][6]["type"] = "ball"; });
  expect_in(refusal(ball), "joint 'wheel_joint' is a ball; write it as three hinges, or hold it: --hold wheel_joint");
  MechanismOptions options;
  options.held = {{"wheel_joint", 0.0}};
  EXPECT_EQ(refusal(ball, options), "");

  const Json loop = changed([](Json& j) {
    j["equalities"][0] = {{"name", "pin"},
                          {"type", "connect"},
                          {"active", true},
                          {"data", {0, 0, 0, 0, 0}},
                          {"bodies", {"wheel", "bracket"}}};
  });
  expect_in(refusal(loop), "connect 'pin' ties link 'wheel' to 'bracket': a closed chain is no tree");
  EXPECT_EQ(refusal(loop, options), "") << "both are one body where the wheel is held";

  expect_in(refusal(changed([](Json& j) { j["equalities"][0]["data"][2] = 0.1; })),
            "equality 'jaws' holds joint 'grip_m");
  expect_in(refusal(changed([](Json& j) { j["equalities"][0]["joints"] = {"grip_mirror"}; })),
            "--hold grip_mirror=0.025");
  expect_in(told(changed([](Json& j) { j["equalities"][0]["active"] = false; })), "equality 'jaws' is switched off");
  expect_in(told(changed([](Json& j) { j["equalities"][0]["type"] = "tendon"; })),
            "equality 'jaws' (tendon) is not read");
  expect_in(told(changed([](Json& j) { j["bodies"][3]["gravcomp"] = 1.0; })), "link arm: gravcomp is not read");
  expect_in(told(changed([](Json& j) { j["density"] = 1.2; })), "density and viscosity are not read");
  expect_in(told(changed([](Json& j) { j["plugins"] = {"elastic"}; })), "plugin elastic: not read");
  expect_in(told(changed([](Json& j) { j["gravity"][1] = 2.0; })), "gravity along y (2 m/s2) is left out");
  expect_in(told(changed([](Json& j) { j["actuators"][2]["bias_values"] = {0, 0, -1}; })), "velocity servo lifter");
  expect_in(told(changed([](Json& j) {
              j["actuators"][1]["control_range"] = {0, 5};
            })),
            "actuator turner: pushes one way");
  expect_in(told(changed([](Json& j) { j["actuators"] = Json::array(); })), "every joint is taken as driven");
  expect_in(told(changed([](Json& j) { j["joints"][1]["beyond"] = {"springs of higher order"}; })),
            "joint 'pan' has springs of higher order: not read");
  expect_in(
      told(changed([](Json& j) {
        j["touching"] = 9;
        j["touching_world"] = {"arm", "a", "b", "c", "d", "e"};
      })),
      "CONTACTS are not read: 9 shapes may touch something, those of arm, a, b, c and 2 more also what stands on the "
      "world; ");
  // the toy gets a limb: two robots; the machine floats itself: the toy is left out, and the base may move
  expect_in(refusal(changed([](Json& j) {
              j["joints"][6]["body"] = 8;
              j["bodies"][7]["parent"] = 8;
            })),
            "body 'toy' floats beside a robot that stands on the world");
  const Json afloat = changed([](Json& j) {
    Json free = j["joints"][7];
    free["name"] = "root";
    free["body"] = 1;
    for (int b = 1; b < 8; ++b) j["bodies"][static_cast<std::size_t>(b)]["on_world"] = false;
    j["joints"].insert(j["joints"].begin(), free);
    j["keyframes"] = Json::array();
  });
  expect_in(told(afloat), "joint 'root' is free and held where the file puts it; --base free lets it move");
  MechanismOptions floating;
  floating.base = BaseKind::free;
  EXPECT_EQ(told(afloat, floating).find("root"), std::string::npos);
}

TEST(Mjcf, AnAnswerThatIsNoneIsTold) {
  expect_in(refusal(Json{{"error", "MuJoCo does not compile it: no"}}), "machine.xml: MuJoCo does not compile it: no");
  expect_in(refusal(Json{{"name", "x"}}), "machine.xml: what tiller_tools.mjcf says of it cannot be read");
  Json broken = machine();
  broken["joints"][1]["pos"] = "here";
  expect_in(refusal(broken), "cannot be read");
}

// The root element decides, not the ending.
TEST(Mjcf, TheFormatIsToldByTheContent) {
  ASSERT_EQ(setenv("TILLER_PYTHON", TILLER_STORED_MUJOCO, 1), 0);
  const std::string stem = ::testing::TempDir() + "mjcf_test_format";
  std::ofstream(stem + ".urdf") << text_of(TILLER_MACHINE ".xml");
  std::ofstream(stem + ".json") << text_of(TILLER_MACHINE ".json");
  Description robot;
  std::vector<std::string> errors;
  EXPECT_TRUE(read_description(stem + ".urdf", robot, errors)) << errors[0];
  EXPECT_EQ(robot.name, "test machine");
  std::ofstream(stem + ".xml") << "<robot name=\"r\"><link name=\"l\"/></robot>";
  EXPECT_TRUE(read_description(stem + ".xml", robot, errors));
  EXPECT_EQ(robot.name, "r");
  ASSERT_EQ(setenv("TILLER_PYTHON", "false", 1), 0);
  EXPECT_FALSE(read_description(stem + ".urdf", robot, errors));
  expect_in(errors.back(), stem + ".urdf: ");
}

}  // namespace
}  // namespace tiller::tools
