// The ODE world of a description against Newton and Euler in the world's frame, which share nothing with it but the
// file.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "newton_euler.hpp"
#include "sim/plant/plant.hpp"
#include "tools/import/described_plant.hpp"

namespace tiller_test {
namespace {

using namespace tiller::tools;
namespace sim = tiller::sim;
using Values = NewtonEuler::Values;

constexpr int kJoints = 4;
const char* const kNames[kJoints] = {"pan", "lift", "reach", "look"};
const char* const kPositions[kJoints] = {"pan_rad", "lift_rad", "reach_m", "look_rad"};
const char* const kRates[kJoints] = {"pan_rad_s", "lift_rad_s", "reach_m_s", "look_rad_s"};
constexpr double kGrip_rad = 0.3, kMirror_rad = -0.2;  // where the gripper's fingers are held

DescribedPlant described() {
  DescribedPlant plant;
  plant.file = TILLER_ARM_URDF;
  plant.frame = "lens";
  plant.hold = {{"grip", kGrip_rad}, {"grip_mirror", kMirror_rad}};
  return plant;
}

struct Point {
  double q[kJoints], v[kJoints], force[kJoints];
};
Point random_point(std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  Point p;
  for (int j = 0; j < kJoints; ++j) {
    p.q[j] = j == 2 ? 0.15 + 0.1 * unit(random) : j == 3 ? 0.8 * unit(random) : 1.5 * unit(random);  // within the ends
    p.v[j] = 2.0 * unit(random);
    p.force[j] = 5.0 * unit(random);
  }
  return p;
}

class TreePlant : public ::testing::Test {
 protected:
  void SetUp() override {
    std::vector<std::string> errors;
    ASSERT_TRUE(read_urdf(TILLER_ARM_URDF, robot_, errors));
    tree_ = describe_plant(described(), errors);
    ASSERT_NE(tree_, nullptr) << (errors.empty() ? "" : errors[0]);
    for (JointText& joint : robot_.joints) joint.mimics.clear();
  }

  sim::PlantOptions options(const Point& p, double step_s) const {
    sim::PlantOptions o;
    o.made = std::make_shared<const sim::MechanismInfo>(sim::tree_info(tree_));
    o.step_s = step_s;
    o.watchdog_timeout_s = 0;
    for (int j = 0; j < kJoints; ++j) {
      o.initial_state[kPositions[j]] = p.q[j];
      o.initial_state[kRates[j]] = p.v[j];
    }
    return o;
  }
  /// For motions that would run into the joints' ends.
  void take_ends_away() {
    auto endless = std::make_shared<sim::Tree>(*tree_);
    for (sim::TreeJoint& joint : endless->joints) {
      joint.high = std::numeric_limits<double>::infinity();
      joint.low = -joint.high;
    }
    tree_ = endless;
  }
  static std::unique_ptr<sim::Plant> make(const sim::PlantOptions& o) {
    std::string error;
    auto plant = sim::Plant::make(o, error);
    EXPECT_NE(plant, nullptr) << error;
    return plant;
  }
  static std::vector<double> state_of(const sim::Plant& plant) {
    std::vector<double> state(2 * kJoints);
    plant.true_state(state.data());
    return state;
  }

  /// Accelerations by ODE, in the middle of one short step.
  static Eigen::VectorXd stepped(const sim::PlantOptions& o, const Point& p) {
    auto plant = make(o);
    plant->apply(p.force);
    plant->advance(o.step_s);
    const auto state = state_of(*plant);
    Eigen::VectorXd a(kJoints);
    for (int j = 0; j < kJoints; ++j) a[j] = (state[kJoints + j] - p.v[j]) / o.step_s;
    return a;
  }

  static Values with_held(const double* value, bool position) {
    Values all;
    for (int j = 0; j < kJoints; ++j) all[kNames[j]] = value[j];
    all["grip"] = position ? kGrip_rad : 0.0;
    all["grip_mirror"] = position ? kMirror_rad : 0.0;
    return all;
  }
  Eigen::VectorXd inverse(const Point& p, const Eigen::VectorXd& acceleration) const {
    const Values f = NewtonEuler(robot_).forces(with_held(p.q, true), with_held(p.v, false),
                                                with_held(acceleration.data(), false), {0.0, 0.0, -9.81});
    Eigen::VectorXd out(kJoints);
    for (int j = 0; j < kJoints; ++j) out[j] = f.at(kNames[j]);
    return out;
  }
  Eigen::VectorXd accelerations(const Point& p) const {
    const Eigen::VectorXd bias = inverse(p, Eigen::VectorXd::Zero(kJoints));
    Eigen::MatrixXd m(kJoints, kJoints);
    for (int j = 0; j < kJoints; ++j) m.col(j) = inverse(p, Eigen::VectorXd::Unit(kJoints, j)) - bias;
    return m.ldlt().solve(Eigen::Map<const Eigen::VectorXd>(p.force, kJoints) - bias);
  }
  /// Newton's and Euler's accelerations where ODE makes its step.
  Eigen::VectorXd halfway(Point p, double step_s) const {
    for (int j = 0; j < kJoints; ++j) p.q[j] += 0.5 * step_s * p.v[j];
    return accelerations(p);
  }

  void expect_same(const sim::PlantOptions& o, const Point& p) const {
    const Eigen::VectorXd ours = stepped(o, p), theirs = halfway(p, o.step_s);
    // the solver's constraint rows, and the difference of two rates over the step, leave some 1e-9
    EXPECT_LT((ours - theirs).cwiseAbs().maxCoeff(), 1e-6 * theirs.cwiseAbs().maxCoeff())
        << ours.transpose() << " against " << theirs.transpose();
  }

  Description robot_;
  std::shared_ptr<const sim::Tree> tree_;
};

// With rotors behind the gears: the file gives two joints an armature.
TEST_F(TreePlant, AccelerationsAreNewtonsAndEulers) {
  std::mt19937 random(1);
  for (int k = 0; k < 100; ++k) {
    const Point p = random_point(random);
    expect_same(options(p, 1e-4), p);
  }
}

TEST_F(TreePlant, APayloadIsABodyAtItsFrame) {
  LinkText ball{"ball", 0, true, {}};
  ball.body.mass_kg = 1.3;
  JointText weld;
  weld.name = "weld";
  weld.parent = "lens";
  weld.child = "ball";
  robot_.links.push_back(ball);
  robot_.joints.push_back(weld);
  std::mt19937 random(2);
  for (int k = 0; k < 20; ++k) {
    const Point p = random_point(random);
    sim::PlantOptions o = options(p, 1e-4);
    o.effects.push_back({"payload", "", {{"mass_kg", 1.3}}});
    expect_same(o, p);
  }
}

TEST_F(TreePlant, MassesAndGainsAreParameters) {
  for (LinkText& link : robot_.links)
    if (link.name == "slide") {
      link.body.mass_kg *= 1.5;
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) link.body.inertia_kgm2(r, c) *= 1.5;
    }
  std::mt19937 random(3);
  for (int k = 0; k < 20; ++k) {
    Point p = random_point(random);
    sim::PlantOptions o = options(p, 1e-4);
    o.parameters = {{"slide_mass_kg", 1.5 * 0.8}, {"look_gain", 0.7}};
    const Eigen::VectorXd ours = stepped(o, p);
    p.force[3] *= 0.7;
    const Eigen::VectorXd theirs = halfway(p, o.step_s);
    EXPECT_LT((ours - theirs).cwiseAbs().maxCoeff(), 1e-6 * theirs.cwiseAbs().maxCoeff());
  }
}

TEST_F(TreePlant, ErrorFallsWithTheSquareOfTheStep) {
  take_ends_away();
  std::mt19937 random(4);
  const Point p = random_point(random);
  const auto end = [&](double step_s) {
    auto plant = make(options(p, step_s));
    for (int k = 0; k < 50; ++k) {
      double u[kJoints];
      for (int j = 0; j < kJoints; ++j) u[j] = p.force[j] * std::sin(0.1 * k + j);
      plant->apply(u);
      plant->advance(0.01);
    }
    return state_of(*plant);
  };
  const auto apart = [](const std::vector<double>& a, const std::vector<double>& b) {
    double most = 0;
    for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::fabs(a[i] - b[i]));
    return most;
  };
  const auto fine = end(2e-5);
  const double coarse = apart(end(4e-4), fine), half = apart(end(2e-4), fine);
  EXPECT_NEAR(coarse / half, 4.0, 0.4) << coarse << " " << half;
}

TEST_F(TreePlant, KeepsItsEnergy) {
  take_ends_away();
  std::mt19937 random(5);
  const Point p = random_point(random);
  auto plant = make(options(p, 1e-4));
  const double before = plant->energy_J();
  double most = 0;
  for (int k = 0; k < 100; ++k) {
    plant->advance(0.01);
    most = std::max(most, std::fabs(plant->energy_J() - before));
  }
  // of an arm of ten kilograms that swings a metre: some 50 J change hands
  EXPECT_LT(most, 2e-3);
}

TEST_F(TreePlant, StaysWithinItsStops) {
  Point p{};
  auto plant = make(options(p, 5e-4));
  const double push[kJoints] = {0, 200, 0, 0};
  plant->apply(push);
  double most = 0;
  for (int k = 0; k < 200; ++k) {
    plant->advance(0.01);
    most = std::max(most, state_of(*plant)[1]);
  }
  // it runs into its end of 2.5 rad at some 50 rad/s, and is back within 5 % a step
  EXPECT_GT(most, 2.4);
  EXPECT_LT(most, 2.6);
  EXPECT_NEAR(state_of(*plant)[1], 2.5, 0.02);
}

TEST_F(TreePlant, WhatItCannotBeIsSaid) {
  const auto problem = [](const DescribedPlant& plant) {
    std::vector<std::string> errors;
    EXPECT_EQ(describe_plant(plant, errors), nullptr);
    return errors.empty() ? std::string() : errors[0];
  };
  DescribedPlant plant = described();
  plant.hold.clear();
  EXPECT_NE(problem(plant).find("'grip_mirror' follows another"), std::string::npos) << problem(plant);
  plant = described();
  plant.frame = "lense";
  EXPECT_NE(problem(plant).find("has no link 'lense'"), std::string::npos) << problem(plant);
  plant = described();
  plant.file = "none.urdf";
  EXPECT_NE(problem(plant).find("none.urdf"), std::string::npos) << problem(plant);
}

}  // namespace
}  // namespace tiller_test
