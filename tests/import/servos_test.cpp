// Drives with laws of their own, as an MJCF has them: with --servos the imported equations and the numbers of the robot
// file's effects give MuJoCo's accelerations, which are stored (mjcf_test.py --write). What has no form is told.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "servo_arm.hpp"  // as imported
#include "tools/description/description.hpp"
#include "tools/import/mechanism.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::json;
using Arm = ServoArm<double>;

constexpr int kJoints = 4;
const char* const kNames[kJoints] = {"shoulder", "elbow", "wrist", "left_finger"};

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
Json arm() { return Json::parse(text_of(TILLER_SERVOS ".json")); }

Mechanism built(const Json& json, bool servos, std::string* refusal = nullptr) {
  Description robot;
  Mechanism mechanism;
  MechanismOptions options;
  options.servos = servos;
  std::vector<std::string> errors;
  const bool good = read_compiled_mjcf(json.dump(), "servos.xml", robot, errors) &&
                    build_mechanism(robot, options, mechanism, errors);
  if (refusal != nullptr) *refusal = errors.empty() ? "" : errors[0];
  EXPECT_EQ(good, refusal == nullptr) << (errors.empty() ? "" : errors[0]);
  return mechanism;
}
const MovingBody& body_of(const Mechanism& mechanism, const std::string& joint) {
  for (const MovingBody& body : mechanism.bodies)
    if (body.joint == joint) return body;
  ADD_FAILURE() << joint;
  return mechanism.bodies[0];
}
std::string left_out(const Mechanism& mechanism) {
  std::string all;
  for (const std::string& what : mechanism.left_out) all += what + "\n";
  return all;
}
void expect_in(const std::string& all, const std::string& part) { EXPECT_NE(all.find(part), std::string::npos) << all; }

/// What the effects of the robot file and the command push with: position_servo, viscous_friction, linear_spring and
/// constant_offset, by their equations (docs/reference/effects.md).
double joint_force(const MovingBody& body, double control, double q, double v) {
  const double command = body.law.goal_per_control * control;
  const double drive =
      body.has_goal() ? std::clamp(body.law.stiffness * (body.law.goal_at_zero + command - q) - body.law.damping * v,
                                   -body.law.limit, body.law.limit)
                      : command;
  return drive - body.damping * v - body.stiffness * (q - body.rest) + body.offset;
}

TEST(Servos, AccelerationsAreMuJoCos) {
  const Mechanism mechanism = built(arm(), true);
  const Json rows = Json::parse(text_of(TILLER_SERVOS "_accelerations.json"));
  ASSERT_GE(rows.size(), 40u);
  int limited = 0;
  for (const Json& row : rows) {
    const auto q = row["q"].get<std::vector<double>>(), v = row["v"].get<std::vector<double>>();
    const auto control = row["control"].get<std::vector<double>>(), theirs = row["a"].get<std::vector<double>>();
    double state[2 * kJoints], force[kJoints], scale = 0.0;
    for (std::size_t j = 0; j < kJoints; ++j) {
      const MovingBody& body = body_of(mechanism, kNames[j]);
      state[j] = q[j];
      state[kJoints + j] = v[j];
      force[j] = joint_force(body, control[j], q[j], v[j]);
      if (std::isfinite(body.law.limit) &&
          std::fabs(body.law.stiffness * (body.law.goal_at_zero + body.law.goal_per_control * control[j] - q[j]) -
                    body.law.damping * v[j]) > body.law.limit)
        ++limited;
      scale = std::max(scale, std::fabs(theirs[j]));
    }
    Arm::State x;
    Arm::Force f;
    static_assert(sizeof x == sizeof state && sizeof f == sizeof force);
    std::memcpy(static_cast<void*>(&x), state, sizeof state);
    std::memcpy(static_cast<void*>(&f), force, sizeof force);
    const Arm::State dx = Arm::dynamics(x, {}, f, {0.0, -9.81, 0.0, 0.0});
    double ours[2 * kJoints];
    std::memcpy(ours, static_cast<const void*>(&dx), sizeof ours);
    for (std::size_t j = 0; j < kJoints; ++j) EXPECT_NEAR(ours[kJoints + j], theirs[j], 1e-11 * scale) << kNames[j];
  }
  EXPECT_GT(limited, 5) << "some states are at a force's limit";
}

TEST(Servos, TheRobotFileHasTheLaws) {
  const std::string file = text_of(TILLER_SERVOS_ROBOT);
  expect_in(file,
            "# position servo lift: the input is its goal; goal = 0.5 times MuJoCo's ctrl\n[[effects]]\n"
            "kind = \"position_servo\"\nport = \"shoulder_Nm\"\nstiffness_SI = 1600\ndamping_SI = 100\n"
            "limit_SI = 120\n");
  expect_in(file, "port = \"elbow_Nm\"\nstiffness_SI = 135\ndamping_SI = 9\nlimit_SI = 0   # none\n");
  expect_in(file, "kind = \"viscous_friction\"\nport = \"wrist\"\ndamping_SI = 5.4");
  expect_in(file, "kind = \"linear_spring\"\nport = \"left_finger\"\nstiffness_SI = 138.75\n");
  expect_in(file, "kind = \"constant_offset\"\nport = \"left_finger\"\nforce_SI = 1.32\n");
  expect_in(file, "shoulder_Nm = { low = -2, high = 2, safe = 0.3, rate_per_s = 3 }");
  expect_in(file, "left_finger_N = { low = 0, high = 0.0292, safe = 0.02, rate_per_s = 0.5 }");
  EXPECT_EQ(file.find("hold_gain.shoulder_Nm"), std::string::npos) << "a gain of forces, on a goal";
}

TEST(Servos, WithoutTheOptionInputsAreForces) {
  const Mechanism mechanism = built(arm(), false);
  EXPECT_FALSE(body_of(mechanism, "shoulder").has_goal());
  EXPECT_EQ(body_of(mechanism, "shoulder").effort, 120.0) << "the force's limit through gear 2";
  EXPECT_EQ(body_of(mechanism, "wrist").damping, 0.0);
  EXPECT_EQ(body_of(mechanism, "left_finger").effort, 50.0) << "0.5 + 0.4 x 1.25 times 50";
  const std::string told = left_out(mechanism);
  for (const char* part :
       {"position servo lift: the law is not read", "velocity servo twist: the law is not read",
        "stiffness_SI = 200, damping_SI = 20, limit_SI = 50; MuJoCo's ctrl is (goal - -0.0008) / 0.0015"})
    expect_in(told, part);
}

TEST(Servos, WhatHasNoFormIsTold) {
  const auto changed = [](const std::function<void(Json&)>& change) {
    Json json = arm();
    change(json);
    return json;
  };
  const auto told = [&](const std::function<void(Json&)>& change) { return left_out(built(changed(change), true)); };
  expect_in(told([](Json& j) { j["actuators"][1]["bias_values"][1] = 60.0; }),
            "position servo bend: the law is not read: the input is the joint's force; it pushes the joint away");
  expect_in(told([](Json& j) { j["actuators"][1]["gain"] = "affine"; }), "affine actuator bend: the law is not read");
  expect_in(told([](Json& j) {
              Json motor = j["actuators"][0];
              motor["name"] = "more";
              motor["bias"] = "none";
              j["actuators"].push_back(motor);
            }),
            "position servo lift: the law is not read");
  expect_in(told([](Json& j) {
              j["tendons"][0]["joints"].push_back({"wrist", 1.0});
            }),
            "actuator grasp (tendon split): drives no hinge or slide by itself");
  expect_in(told([](Json& j) { j["tendons"][1]["spring_range"] = {0.0, 0.02}; }), "tendon opener: ");
  expect_in(told([](Json& j) {
              j["actuators"][2]["force_limited"] = true;
              j["actuators"][2]["force_range"] = {-1, 1};
            }),
            "velocity servo twist: the limit of its force counts for input and damping together");
  // a velocity servo beside a position servo is its damping
  const Mechanism pair = built(changed([](Json& j) {
                                 Json brake = j["actuators"][2];
                                 brake["target"] = "shoulder";
                                 j["actuators"][2] = brake;
                               }),
                               true);
  EXPECT_DOUBLE_EQ(body_of(pair, "shoulder").law.damping, 100.0 + 0.6 * 9.0);
  std::string refusal;
  (void)built(changed([](Json& j) { j["actuators"] = Json::array(); }), true, &refusal);
  expect_in(refusal, "--servos: servos.xml has no actuator whose law can be taken");
}

/// A tendon's ends are the joint's, through coefficient and coupling.
TEST(Servos, ATendonsEndsAreTheJoints) {
  Json json = arm();
  json["tendons"][0]["limited"] = true;
  json["tendons"][0]["acts"] = true;
  json["tendons"][0]["range"] = {0.0058, 0.0308};  // 0.5 q + 0.4 (1.25 q + 0.002) = q + 0.0008
  const Mechanism mechanism = built(json, true);
  EXPECT_NEAR(body_of(mechanism, "left_finger").low, 0.005, 1e-15);
  EXPECT_NEAR(body_of(mechanism, "left_finger").high, 0.03, 1e-15);
}

}  // namespace
}  // namespace tiller::tools
