// Which unknowns a robot's motions can tell: against base parameters derived by hand, and counts of the literature.
#include "tools/import/identifiable.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <random>

#include "newton_euler.hpp"
#include "tools/import/inverse_dynamics.hpp"

namespace tiller::tools {
namespace {

struct Link {
  const char* axis;
  const char* origin;  // of the joint in the link before: "xyz" then "rpy"
  const char* turn;
  const char* centre;
  double mass, ixx, iyy, izz;
};

std::string urdf_of(const std::vector<Link>& links, const std::string& more = "") {
  std::string text = "<robot name=\"r\"><link name=\"l0\"/>\n";
  int k = 0;
  for (const Link& l : links) {
    const std::string name = "l" + std::to_string(++k), joint = "j" + std::to_string(k);
    text += "<link name=\"" + name + "\"><inertial><origin xyz=\"" + l.centre + "\"/><mass value=\"" +
            std::to_string(l.mass) + "\"/><inertia ixx=\"" + std::to_string(l.ixx) + "\" iyy=\"" +
            std::to_string(l.iyy) + "\" izz=\"" + std::to_string(l.izz) + "\"/></inertial></link>\n<joint name=\"" +
            joint + "\" type=\"continuous\"><origin xyz=\"" + l.origin + "\" rpy=\"" + l.turn + "\"/><parent link=\"l" +
            std::to_string(k - 1) + "\"/><child link=\"" + name + "\"/><axis xyz=\"" + l.axis +
            "\"/><limit effort=\"50\" velocity=\"3\"/></joint>\n";
  }
  return text + more + "</robot>\n";
}

struct Robot {
  Description description;
  Mechanism mechanism;
  Unknowns unknowns;
  Identifiability found;

  Robot(const std::string& text, const std::vector<std::string>& words, const MechanismOptions& options = {}) {
    const std::string path = ::testing::TempDir() + "identifiable_test.urdf";
    std::ofstream(path) << text;
    std::vector<std::string> errors;
    EXPECT_TRUE(read_urdf(path, description, errors) && build_mechanism(description, options, mechanism, errors) &&
                read_unknowns(words, mechanism, unknowns, errors))
        << (errors.empty() ? "" : errors[0]);
    const int frame = mechanism.find_frame("l" + std::to_string(mechanism.bodies.size()));
    found = find_identifiable(mechanism, unknowns, frame);
  }
  std::vector<std::string> unseen() const {
    std::vector<std::string> names;
    for (const int i : found.unseen) names.push_back(found.unknowns[static_cast<std::size_t>(i)].name);
    return names;
  }
  std::string all_notes() const {
    std::string all;
    for (const std::string& note : identifiable_notes(found, true)) all += note + "\n";
    return all;
  }
};

// Two parallel axes. Across them (gravity along the axes) no weight shows.
constexpr double kLength = 0.5;
const Link kUpper{"0 0 1", "0 0 0", "0 0 0", "0.2 0 0.02", 2.0, 0.01, 0.03, 0.035};
const Link kFore{"0 0 1", "0.5 0 0", "0 0 0", "0.15 0 0.01", 1.0, 0.005, 0.015, 0.012};
const std::string kFlat = urdf_of({kUpper, kFore});
// The same in a vertical plane.
const std::string kUpright =
    urdf_of({{"0 0 1", "0 0 0", "1.5707963267948966 0 0", "0.2 0 0.02", 2.0, 0.01, 0.03, 0.035}, kFore});

// ZZ1 + m2 l^2, ZZ2, MX2 and MY2 without weight, and MX1 + m2 l and MY1 with it (Khalil and Dombre 2002, chapter 9).
TEST(Identifiable, ATwoLinkArmHasFourBaseParametersAndSixUnderGravity) {
  EXPECT_EQ(Robot(kFlat, {"inertia:*"}).found.rank, 4u);
  EXPECT_EQ(Robot(kUpright, {"inertia:*"}).found.rank, 6u);
}

// Of the upper link only the inertia about its axis shows, in sum with the forearm's mass times l^2.
TEST(Identifiable, MassesThatShowAsASumAreToldWithTheirFactors) {
  // nothing but the masses: m1 shows in ZZ1 alone, m2 in its own parameters too, so both show
  EXPECT_EQ(Robot(kFlat, {"mass:*"}).found.rank, 2u);
  // a bracket that is screwed to the upper link turns with it
  const std::string bracket =
      "<link name=\"bracket\"><inertial><origin xyz=\"0.1 0 0\"/><mass value=\"0.5\"/><inertia ixx=\"0.002\" iyy=\"0.002\" "
      "izz=\"0.003\"/></inertial></link><joint name=\"screw\" type=\"fixed\"><origin xyz=\"0.2 0 0\"/><parent link=\"l1\"/>"
      "<child link=\"bracket\"/></joint>";
  const Robot robot(urdf_of({kUpper, kFore}, bracket), {"mass:l1", "mass:bracket"});
  EXPECT_EQ(robot.found.rank, 1u);
  ASSERT_EQ(robot.found.shared.size(), 1u);
  const auto& terms = robot.found.shared[0].terms;
  ASSERT_EQ(terms.size(), 2u);
  EXPECT_DOUBLE_EQ(terms[0].factor, 1.0);
  // inertia about the axis for each kg of either
  const double of_bracket = 0.003 / 0.5 + 0.3 * 0.3, of_upper = 0.035 / 2.0 + 0.2 * 0.2;
  EXPECT_NEAR(terms[1].factor, of_bracket / of_upper, 1e-9);
  EXPECT_NE(robot.all_notes().find("l1_mass_kg + 1.67 bracket_mass_kg"), std::string::npos) << robot.all_notes();
}

// The last link in the plane has m (through l), MX, MY and ZZ = sx + sy + m c^2, with second moments s: ten coordinates
// move them by size, stretch_x and stretch_y in the ratio of their moments, and the shifts in the plane.
TEST(Identifiable, CoordinatesOfALinkThatStaysInAPlane) {
  const Robot robot(kFlat, {"inertia:l2"});
  EXPECT_EQ(robot.unseen(),
            (std::vector<std::string>{"l2_stretch_z", "l2_shear_xy", "l2_shear_yz", "l2_shear_xz", "l2_shift_z_m"}));
  EXPECT_EQ(robot.found.rank, 4u);
  ASSERT_EQ(robot.found.shared.size(), 1u);
  const double half = 0.5 * (0.005 + 0.015 + 0.012);
  EXPECT_EQ(combination_text(robot.found, robot.found.shared[0]).substr(0, 15), "l2_stretch_x + ");
  EXPECT_NEAR(robot.found.shared[0].terms[1].factor, (half - 0.015) / (half - 0.005), 1e-9);
  EXPECT_NE(robot.all_notes().find("l2: 5 of 10 inertial coordinates move no joint force: stretch_z, shear_xy, "
                                   "shear_yz, shear_xz, shift_z_m; held"),
            std::string::npos)
      << robot.all_notes();
}

// Unknowns may be scaled with the gains where nothing known has a force: neither friction nor a rotor.
TEST(Identifiable, MassesAndGainsShowAsRatiosUntilSomethingKnownHasAForce) {
  EXPECT_EQ(Robot(kUpright, {"mass:*", "gain:*"}).found.rank, 3u);
  MechanismOptions rotor;
  rotor.armature = {{"j2", 0.1}};
  EXPECT_EQ(Robot(kUpright, {"mass:*", "gain:*"}, rotor).found.rank, 4u);
  EXPECT_EQ(Robot(kUpright, {"mass:*", "gain:*", "friction:*"}).found.rank, 7u);   // scaled as well
  EXPECT_EQ(Robot(kUpright, {"mass:*", "gain:j1", "friction:*"}).found.rank, 7u);  // the other gain is known
}

TEST(Identifiable, ALoadOnAnUprightAxisIsNotFelt) {
  const Link turret{"0 0 1", "0 0 0", "0 0 0", "0.1 0 0.02", 2.0, 0.01, 0.03, 0.035};
  const Robot robot(urdf_of({turret}), {"payload"});
  EXPECT_EQ(robot.found.rank, 0u);
  EXPECT_EQ(robot.unseen(), std::vector<std::string>{"payload's mass_kg"});
  EXPECT_NE(robot.all_notes().find("payload's mass_kg of l1 moves no joint force"), std::string::npos);
}

TEST(Identifiable, ASixAxisArmHasThirtySix) {
  // n = 6 revolute axes of which the first stands upright: 7 n - 6 (Mayeda, Yoshida and Osuka, IEEE T-RA 6, 1990; the
  // 36 of the PUMA 560, Gautier and Khalil, IEEE T-RA 6, 1990); pinocchio's regressor has the same rank on the UR5.
  const auto link = [](const char* origin, const char* turn) {
    return Link{"0 0 1", origin, turn, "0.03 0.02 0.05", 1.5, 0.02, 0.03, 0.025};
  };
  const char *up = "0 0 0", *left = "-1.5707963267948966 0 0", *right = "1.5707963267948966 0 0";
  const std::vector<Link> puma{link("0 0 0.6", up),        link("0 0 0", left),  link("0.4318 0 0.15", up),
                               link("0.02 -0.43 0", left), link("0 0 0", right), link("0 0 0", left)};
  const Robot robot(urdf_of(puma), {"inertia:*"});
  EXPECT_EQ(robot.found.rank, 36u);
  // far from the threshold on either side
  EXPECT_GT(robot.found.smallest_kept, 1e-4);
  EXPECT_LT(robot.found.largest_dropped, 1e-11);
  // three parallel axes, as the UR5 has
  const std::vector<Link> ur{link("0 0 0.09", up), link("0 0.14 0", left),  link("0.425 0 -0.12", up),
                             link("0.39 0 0", up), link("0 0.09 0", right), link("0 0 0.09", left)};
  EXPECT_EQ(Robot(urdf_of(ur), {"inertia:*"}).found.rank, 36u);
}

/// The body x -> exp(size) (B (x - c) + shift) + c of the mass (Rucker and Wensing 2022), by its moments.
BodyInertia<double> deformed(const RigidBody& b, const std::array<double, 10>& p) {
  Mat3<double> deformation;
  for (int k = 0; k < 3; ++k) deformation(k, k) = std::exp(p[static_cast<std::size_t>(1 + k)]);
  deformation(0, 1) = p[4], deformation(1, 2) = p[5], deformation(0, 2) = p[6];
  const double half = 0.5 * (b.inertia_kgm2(0, 0) + b.inertia_kgm2(1, 1) + b.inertia_kgm2(2, 2));
  Mat3<double> second;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) second(r, c) = (r == c ? half : 0.0) - b.inertia_kgm2(r, c);
  second = deformation * second * deformation.transposed();
  const double mass = std::exp(2.0 * p[0]) * b.mass_kg;
  const Vec3<double> centre{b.com_m[0] + p[7], b.com_m[1] + p[8], b.com_m[2] + p[9]};
  BodyInertia<double> out;
  out.mass = mass;
  for (int r = 0; r < 3; ++r) {
    const auto i = static_cast<std::size_t>(r);
    out.moment[i] = mass * centre[i];
    for (int c = 0; c < 3; ++c) {
      const auto j = static_cast<std::size_t>(c);
      const double trace = second(0, 0) + second(1, 1) + second(2, 2);
      out.inertia(r, c) = std::exp(2.0 * p[0]) * ((r == c ? trace : 0.0) - second(r, c)) +
                          mass * ((r == c ? dot(centre, centre) : 0.0) - centre[i] * centre[j]);
    }
  }
  return out;
}

/// Largest change of the joints' forces over some motions, all coordinates changed as `change` says (10 a body).
double force_change(const Robot& robot, const std::vector<double>& change) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const auto forces = [&](double share, const std::vector<double>& q, const std::vector<double>& v,
                          const std::vector<double>& a) {
    std::vector<BodyInertia<double>> inertia;
    for (std::size_t i = 0; i < robot.mechanism.bodies.size(); ++i) {
      std::array<double, 10> p{};
      for (std::size_t k = 0; k < 10; ++k) p[k] = share * change[10 * i + k];
      inertia.push_back(deformed(robot.mechanism.bodies[i].links[0].body, p));
    }
    return joint_forces<double>(robot.mechanism, inertia, q, v, a, {0.0, 0.0, 9.81});
  };
  double largest = 0.0;
  const std::size_t n = robot.mechanism.bodies.size();
  for (int motion = 0; motion < 20; ++motion) {
    std::vector<double> q(n), v(n), a(n);
    for (std::size_t j = 0; j < n; ++j) q[j] = 3.0 * unit(random), v[j] = 2.0 * unit(random), a[j] = 4.0 * unit(random);
    // central differences leave the third order alone
    const auto above = forces(1.0, q, v, a), below = forces(-1.0, q, v, a);
    for (std::size_t j = 0; j < n; ++j) largest = std::max(largest, 0.5 * std::fabs(above[j] - below[j]));
  }
  return largest;
}

// Coordinates that change against each other as the sums say leave the forces alone; each of them by itself does not.
TEST(Identifiable, SumsLeaveTheForcesAloneAndTheirPartsDoNot) {
  const Robot robot(kUpright, {"inertia:*"});
  constexpr double kStep = 1e-4;
  std::map<int, std::vector<double>> changes;  // by what is no head of a sum
  for (const Combination& sum : robot.found.shared)
    for (std::size_t k = 1; k < sum.terms.size(); ++k) {
      auto& change = changes.try_emplace(sum.terms[k].unknown, robot.found.unknowns.size(), 0.0).first->second;
      change[static_cast<std::size_t>(sum.terms[k].unknown)] = kStep;
      change[static_cast<std::size_t>(sum.terms[0].unknown)] = -sum.terms[k].factor * kStep;
    }
  ASSERT_EQ(changes.size(), robot.found.unknowns.size() - robot.found.unseen.size() - robot.found.rank);
  for (const auto& [tail, change] : changes) {
    std::vector<double> alone(change.size(), 0.0);
    alone[static_cast<std::size_t>(tail)] = kStep;
    const double by_itself = force_change(robot, alone);
    EXPECT_GT(by_itself, 1e-7) << tail;
    double scale = 0.0;
    for (const double c : change) scale = std::max(scale, std::fabs(c));
    // what central differences leave of the third order
    EXPECT_LT(force_change(robot, change), 1e3 * scale * scale * scale + 1e-12) << tail;
  }
  for (const int i : robot.found.unseen) {
    std::vector<double> change(robot.found.unknowns.size(), 0.0);
    change[static_cast<std::size_t>(i)] = kStep;
    EXPECT_LT(force_change(robot, change), 1e-12) << robot.found.unknowns[static_cast<std::size_t>(i)].name;
  }
}

// The base parameters themselves, by Newton and Euler in the world's frame, which share nothing with the importer.
TEST(Identifiable, TheForearmsMassMayMoveIntoTheUpperLink) {
  const Robot robot(kUpright, {"inertia:*"});
  const tiller_test::NewtonEuler::Values q{{"j1", 0.7}, {"j2", -1.1}}, v{{"j1", 1.3}, {"j2", -0.4}},
      a{{"j1", 2.1}, {"j2", 3.3}};
  const Vec3<double> gravity{0.0, 0.0, -9.81};
  const auto forces = [&](const Description& d) { return tiller_test::NewtonEuler(d).forces(q, v, a, gravity); };
  // MX1 + m2 l and ZZ1 + m2 l^2 stay as the forearm's mass goes down, and so do its own first and second moments
  Description changed = robot.description;
  const double less = 0.2;
  RigidBody& fore = changed.links[2].body;
  RigidBody& upper = changed.links[1].body;
  const double before = fore.mass_kg, about_origin = 0.012 + before * 0.15 * 0.15;
  fore.mass_kg -= less;
  fore.com_m[0] = 0.15 * before / fore.mass_kg;
  fore.com_m[2] *= before / fore.mass_kg;
  fore.inertia_kgm2(2, 2) = about_origin - fore.mass_kg * fore.com_m[0] * fore.com_m[0];
  const double upper_about_origin = 0.035 + 2.0 * 0.2 * 0.2 + less * kLength * kLength;
  upper.com_m[0] += less * kLength / upper.mass_kg;
  upper.inertia_kgm2(2, 2) = upper_about_origin - upper.mass_kg * upper.com_m[0] * upper.com_m[0];
  const auto same = forces(robot.description), other = forces(changed);
  for (const char* joint : {"j1", "j2"}) EXPECT_NEAR(same.at(joint), other.at(joint), 1e-12) << joint;
}

TEST(Identifiable, WhatNoMotionTellsIsHeldAndTheSumHasItsWholePrior) {
  Robot robot(kFlat, {"inertia:l2"});
  hold_unidentifiable(robot.found, robot.unknowns);
  comment_parameters(robot.found, robot.unknowns);
  std::vector<std::string> held;
  for (const ModelParameter& p : robot.unknowns.parameters) {
    if (p.is_held) held.push_back(p.name);
    EXPECT_EQ(p.is_held, p.comment.find("; held") != std::string::npos) << p.name;
    EXPECT_EQ(p.is_held, p.prior() == "0.0") << p.name;
  }
  EXPECT_EQ(held, (std::vector<std::string>{"l2_stretch_y", "l2_stretch_z", "l2_shear_xy", "l2_shear_yz", "l2_shear_xz",
                                            "l2_shift_z_m"}));
  EXPECT_EQ(robot.unknowns.parameters[1].comment, "stands for l2_stretch_x + 0.0909 l2_stretch_y");
  EXPECT_NEAR(robot.unknowns.parameters[1].sd, 0.1 * std::hypot(1.0, 1.0 / 11.0), 1e-9);
  EXPECT_EQ(robot.unknowns.parameters[2].comment, "shows only with l2_stretch_x; held");
  // every prior that is left can be told
  robot.unknowns.parameters.erase(std::remove_if(robot.unknowns.parameters.begin(), robot.unknowns.parameters.end(),
                                                 [](const ModelParameter& p) { return p.is_held; }),
                                  robot.unknowns.parameters.end());
  EXPECT_EQ(find_identifiable(robot.mechanism, robot.unknowns, -1).rank, robot.unknowns.parameters.size());
}

}  // namespace
}  // namespace tiller::tools
