// Spheres on links: the distances that an import compiles, their slopes, and what [cost.clearance] makes of them.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <random>
#include <sstream>

#include "column_arm.hpp"  // imported with --spheres
#include "newton_euler.hpp"
#include "scalar/dual.hpp"
#include "tools/import/sphere_outputs.hpp"
#include "tools/robot/clearance_file.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

using Arm = ColumnArm<double>;
constexpr double kSoft = 0.001;  // m, of the smooth distance

/// Fields by index: they are all of one type, one behind the other.
template <class S, class Fields>
const S* values_of(const Fields& fields) {
  static_assert(sizeof(Fields) == Fields::count * sizeof(S));
  return reinterpret_cast<const S*>(&fields);
}

/// At rest, with slopes by the three positions.
ColumnArm<Dual<double, 3>>::State seeded(const double* q) {
  ColumnArm<Dual<double, 3>>::State x{};
  Dual<double, 3>* const fields[3] = {&x.yaw_rad, &x.shoulder_rad, &x.elbow_rad};
  for (int i = 0; i < 3; ++i) {
    *fields[i] = Dual<double, 3>(q[i]);
    fields[i]->d[i] = 1.0;
  }
  return x;
}

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

Spheres spheres_of(const std::string& text, std::string* problems = nullptr) {
  const std::string path = ::testing::TempDir() + "spheres.toml";
  std::ofstream(path) << text;
  Spheres spheres;
  std::vector<std::string> errors;
  const bool good = read_sphere_file(path, spheres, errors);
  EXPECT_TRUE(good || problems);
  for (const std::string& error : errors)
    if (problems) *problems += error + "\n";
  return spheres;
}
const std::string kSpheres = text_of(TILLER_SPHERES);

/// Where a sphere's centre is, by another text than the importer's: a link that is screwed there.
Vec3<double> centre(Description robot, const Sphere& sphere, const tiller_test::NewtonEuler::Values& q) {
  if (sphere.is_obstacle()) return sphere.at_m;
  LinkText link;
  link.name = "centre";
  JointText weld;
  weld.name = "weld";
  weld.parent = sphere.link;
  weld.child = link.name;
  weld.origin.position = sphere.at_m;
  robot.links.push_back(link);
  robot.joints.push_back(weld);
  return tiller_test::NewtonEuler(robot).origin_of("centre", q);
}

std::map<std::string, double> outputs_at(const double* q) {
  const Arm::Output y = Arm::outputs({q[0], q[1], q[2], 0.0, 0.0, 0.0});
  std::map<std::string, double> out;
  for (int i = 0; i < Arm::Output::count; ++i) out[Arm::Output::names[i]] = values_of<double>(y)[i];
  return out;
}

TEST(Clearance, DistancesAreThoseOfTheCentres) {
  Description robot;
  std::vector<std::string> errors;
  ASSERT_TRUE(read_urdf(TILLER_COLUMN_ARM, robot, errors));
  const Spheres spheres = spheres_of(kSpheres);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> angle(-2.0, 2.0);
  int found = 0;
  for (int k = 0; k < 20; ++k) {
    const double q[3] = {angle(random), angle(random), angle(random)};
    const tiller_test::NewtonEuler::Values at{{"yaw", q[0]}, {"shoulder", q[1]}, {"elbow", q[2]}};
    const auto y = outputs_at(q);
    for (const Sphere& a : spheres.list) {
      const Vec3<double> ca = centre(robot, a, at);
      if (const auto height = y.find(height_output(a.name)); height != y.end()) {
        EXPECT_NEAR(height->second, ca[2], 1e-13) << a.name;
      }
      for (const Sphere& b : spheres.list) {
        const auto apart = y.find(apart_output(a.name, b.name));
        if (apart == y.end()) continue;
        ++found;
        const Vec3<double> d = ca - centre(robot, b, at);
        EXPECT_NEAR(apart->second, std::sqrt(dot(d, d) + kSoft * kSoft), 1e-13) << a.name << " " << b.name;
      }
    }
  }
  // column (2) with forearm and hand; post with turret, forearm and hand
  EXPECT_EQ(found, 20 * (2 * 2 + 3));
}

// Neighbours, one link, and what may touch are left out; so are heights of what does not move.
TEST(Clearance, OnlyWhatMayCollideIsTold) {
  const double q[3] = {0.1, 0.2, 0.3};
  const auto y = outputs_at(q);
  EXPECT_EQ(y.count("apart_column_1_column_2_m"), 0u);   // one link
  EXPECT_EQ(y.count("apart_column_1_turret_1_m"), 0u);   // joined
  EXPECT_EQ(y.count("apart_forearm_1_hand_1_m"), 0u);    // screwed together
  EXPECT_EQ(y.count("apart_turret_1_forearm_1_m"), 0u);  // may touch
  EXPECT_EQ(y.count("apart_turret_1_hand_1_m"), 0u);     // is the only pair that is named so
  EXPECT_EQ(y.count("height_column_1_m"), 0u);
  EXPECT_EQ(y.count("height_hand_1_m"), 1u);
}

/// What [cost.clearance] costs, as runtime/rollout/output_cost.hpp has it.
template <class S>
S penalty(const typename ColumnArm<S>::State& x, const std::vector<tiller_output_cost_t>& costs) {
  const auto y = ColumnArm<S>::outputs(x);
  S sum = S(0.0);
  for (std::size_t i = 0; i < costs.size(); ++i) {
    const S short_of = max(S(costs[i].low) - values_of<S>(y)[i], S(0.0));
    if (costs[i].bound_weight > 0.0) sum = sum + S(costs[i].bound_weight) * short_of * short_of;
  }
  return sum;
}

/// A robot whose model is at `header`, as far as read_clearance looks.
struct Read {
  std::vector<tiller_output_cost_t> costs;
  std::string errors;

  explicit Read(const std::string& text, const std::string& header = TILLER_COLUMN_ARM_HEADER) {
    FileErrors problems("robot.toml", text);
    RobotFile robot;
    robot.model_request.file = header;
    for (const char* const name : Arm::Output::names) robot.names.outputs.emplace_back(name);
    costs.assign(robot.names.outputs.size(), {0.0, 0.0, 0.0, -INFINITY, INFINITY, 0.0});
    const toml::table root = toml::parse(std::string_view(text), std::string_view("robot.toml"));
    SectionReader cost(problems, "cost", "cost", root["cost"].as_table());
    (void)read_clearance(cost, robot, costs);
    errors = problems.text();
  }
  const tiller_output_cost_t& of(const std::string& output) const {
    const auto names = Arm::Output::names;
    for (std::size_t i = 0; i < costs.size(); ++i)
      if (names[i] == output) return costs[i];
    ADD_FAILURE() << output;
    return costs[0];
  }
};

TEST(Clearance, RadiiAndMarginAreTheRobotFilesAlone) {
  const Read read(kSpheres);
  EXPECT_EQ(read.errors, "");
  EXPECT_DOUBLE_EQ(read.of("apart_column_2_hand_1_m").low, 0.1 + 0.05 + 0.03);
  EXPECT_DOUBLE_EQ(read.of("apart_hand_1_post_m").low, 0.05 + 0.08 + 0.03);
  EXPECT_DOUBLE_EQ(read.of("height_hand_1_m").low, -0.2 + 0.05 + 0.03);
  EXPECT_DOUBLE_EQ(read.of("apart_column_2_hand_1_m").bound_weight, 1e5);
  EXPECT_DOUBLE_EQ(read.of("hand_x_m").bound_weight, 0.0);
  std::string thicker = kSpheres;
  thicker.replace(thicker.find("radius_m = 0.05"), 15, "radius_m = 0.07");
  const Read other(thicker);
  EXPECT_EQ(other.errors, "");
  EXPECT_DOUBLE_EQ(other.of("apart_column_2_hand_1_m").low, 0.1 + 0.07 + 0.03);
}

TEST(Clearance, SlopesAreThoseOfFiniteDifferences) {
  const Read read(kSpheres);
  using D = Dual<double, 3>;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> angle(-2.5, 2.5);
  int active = 0;
  for (int k = 0; k < 200; ++k) {
    const double q[3] = {angle(random), angle(random), angle(random)};
    const D exact = penalty<D>(seeded(q), read.costs);
    active += exact.v > 0.0 ? 1 : 0;
    for (int i = 0; i < 3; ++i) {
      constexpr double kStep = 1e-6;
      const auto at = [&](double step) {
        double p[3] = {q[0], q[1], q[2]};
        p[i] += step;
        return penalty<double>({p[0], p[1], p[2], 0.0, 0.0, 0.0}, read.costs);
      };
      // rounding of the cost over the step
      EXPECT_NEAR(exact.d[i], (at(kStep) - at(-kStep)) / (2.0 * kStep), 1e-6 * (1.0 + exact.v)) << k << " " << i;
    }
  }
  EXPECT_GT(active, 30);
}

// The hand is in the very middle of a column's sphere: sqrt has no slope there, the smooth distance has.
TEST(Clearance, WhereCentresMeetTheSlopeIsFinite) {
  // an isosceles triangle of two links (0.35 m) over the 0.25 m from the shoulder down to the centre
  const double corner = std::acos(0.125 / 0.35);
  const double folded[3] = {0.3, M_PI / 2 - corner, 2.0 * corner};
  const auto y = ColumnArm<Dual<double, 3>>::outputs(seeded(folded));
  EXPECT_NEAR(y.apart_column_2_hand_1_m.v, kSoft, 1e-9);
  for (int i = 12; i < Arm::Output::count; ++i)
    for (int k = 0; k < 3; ++k)  // no point is further than the arm's length from an axis
      EXPECT_LE(std::fabs(values_of<Dual<double, 3>>(y)[i].d[k]), 0.71) << Arm::Output::names[i];
}

TEST(Clearance, AModelOfOtherSpheresIsRefusedWithTheCommandThatWritesItAnew) {
  const auto with = [](const std::string& was, const std::string& now) {
    std::string text = kSpheres;
    EXPECT_NE(text.find(was), std::string::npos) << was;
    return text.replace(text.find(was), was.size(), now);
  };
  const struct {
    std::string text;
    const char* says;
  } cases[] = {
      {with("at_m = [0.17, 0, 0]", "at_m = [0.18, 0, 0]"), "has no sphere forearm_1 on forearm at 0.18 0 0"},
      {with("at_m = [0.5, 0, 0.3]", "at_m = [0.5, 0, 0.4]"), "has no obstacle post at 0.5 0 0.4"},
      {with("may_touch = [[\"turret\", \"forearm\"], [\"turret\", \"hand\"]]", ""), "may_touch has them no more"},
  };
  for (const auto& wrong : cases) {
    const std::string errors = Read(wrong.text).errors;
    EXPECT_NE(errors.find(wrong.says), std::string::npos) << errors;
    EXPECT_NE(errors.find("robot.toml:"), std::string::npos) << errors;
    EXPECT_NE(errors.find("`tiller import "), std::string::npos) << errors;
    EXPECT_NE(errors.find("--model-only`"), std::string::npos) << errors;
  }
  // fewer of them need nothing anew
  EXPECT_EQ(Read(with("obstacles = [{ name = \"post\", at_m = [0.5, 0, 0.3], radius_m = 0.08 }]", "")).errors, "");
  const std::string bare = ::testing::TempDir() + "bare.hpp";
  std::ofstream(bare) << "#pragma once\n";
  EXPECT_NE(Read(kSpheres, bare).errors.find("the model (bare.hpp) knows no spheres"), std::string::npos);
}

TEST(Clearance, MistakesAreToldByLineAndKey) {
  const std::string head = "[cost.clearance]\nweight = 1e5\n";
  const struct {
    std::string text;
    const char* says;
  } cases[] = {
      {"[cost.clearance]\nspheres = [{ link = \"a\", at_m = [0, 0, 0], radius_m = 1 }]\n", "cost.clearance.weight"},
      {head, "cost.clearance.spheres"},
      {head + "spheres = 3\n", "spheres.toml:3: cost.clearance.spheres = 3: is "},
      {head + "spheres = [3]\n", "write a table"},
      {head + "spheres = [{ link = \"a\", at_m = [0, 0], radius_m = 1 }]\n", "is no list of three numbers"},
      {head + "spheres = [{ link = \"a\", at_m = [0, nan, 0], radius_m = 1 }]\n", "at_m"},
      {head + "spheres = [{ link = \"a\", at_m = [0, 0, 0], radius_m = -1 }]\n", "radius_m"},
      {head + "spheres = [{ link = \"a\", at_m = [0, 0, 0] }]\n", "radius_m"},
      {head + "spheres = [{ link = \"a\", at_m = [0, 0, 0], radius = 1 }]\n", "radius"},
      {head + "obstacles = [{ name = \"a b\", at_m = [0, 0, 0], radius_m = 1 }]\n", "use letters, digits"},
      {head + "spheres = [{ link = \"a\", at_m = [0, 0, 0], radius_m = 1 }]\n"
              "obstacles = [{ name = \"a_1\", at_m = [0, 0, 0], radius_m = 1 }]\n",
       "is taken by another sphere"},
      {head + "may_touch = [[\"a\"]]\n", "is no pair of links"},
      {"[cost]\nclearance = 3\n", "spheres.toml:2: cost.clearance"},
      {"[cost\n", "spheres.toml:"},
  };
  for (const auto& wrong : cases) {
    std::string problems;
    (void)spheres_of(wrong.text, &problems);
    EXPECT_NE(problems.find(wrong.says), std::string::npos) << wrong.text << "\n" << problems;
  }
}

TEST(Clearance, WhatTheImportWritesIsWhatItReads) {
  const Spheres spheres = spheres_of(kSpheres), again = spheres_of(clearance_text(spheres));
  EXPECT_EQ(all_marks(again), all_marks(spheres));
  EXPECT_EQ(again.list.size(), 6u);
  EXPECT_DOUBLE_EQ(again.floor_m, spheres.floor_m);
  EXPECT_DOUBLE_EQ(again.list[4].radius_m, spheres.list[4].radius_m);
}

}  // namespace
}  // namespace tiller::tools
