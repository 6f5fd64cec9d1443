// Contacts of imported robots: accelerations and forces beside MuJoCo's, which are stored (contacts_test.py --write),
// and beside the same law solved to its end from MuJoCo's own matrices; what a drop and a rest come to; what is
// refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "gripper.hpp"  // as imported
#include "leg_rig.hpp"
#include "tools/base/text.hpp"
#include "tools/description/description.hpp"
#include "tools/import/contact_choice.hpp"
#include "tools/import/contact_rows.hpp"
#include "tools/import/mechanism.hpp"
#include "tools/import/unknowns.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::json;
using Leg = LegRig<double>;
using Hand = Gripper<double>;

Json json_of(const std::string& name) {
  std::ifstream file(std::string(TILLER_CONTACTS) + "/" + name + ".json", std::ios::binary);
  return Json::parse(std::string{std::istreambuf_iterator<char>(file), {}});
}

template <class Fields>
Fields filled(const std::vector<double>& values) {
  Fields out;
  EXPECT_EQ(sizeof out, sizeof(double) * values.size());
  std::memcpy(static_cast<void*>(&out), values.data(), sizeof out);
  return out;
}
template <class Fields>
std::vector<double> values_of(const Fields& fields) {
  std::vector<double> out(sizeof fields / sizeof(double));
  std::memcpy(out.data(), static_cast<const void*>(&fields), sizeof fields);
  return out;
}

struct Answer {
  std::vector<double> state, rates, gap;
  std::vector<std::array<double, 3>> force;  // along normal and tangents
};

template <class Model>
Answer answer(const std::vector<double>& state, const std::vector<double>& input) {
  constexpr std::size_t places = sizeof Model::contacts / sizeof Model::contacts[0];
  std::vector<double> law;
  for (std::size_t k = 0; k < places; ++k)
    for (const double value : {0.8, 0.01, 1.0}) law.push_back(value);
  const auto x = filled<typename Model::State>(state);
  const auto u = filled<typename Model::Input>(input);
  const auto p = filled<typename Model::Params>(law);
  const auto f = filled<typename Model::Force>(std::vector<double>(state.size() / 2));
  const Body<double> body{0.0, -9.81, 0.0, 0.0};
  Answer out;
  out.state = state;
  out.rates = values_of(Model::dynamics(x, u, f, body, p));
  double force[places][3], gap[places];
  Model::contact_forces(x, u, f, body, p, force, gap);
  for (std::size_t k = 0; k < places; ++k) {
    out.force.push_back({force[k][0], force[k][1], force[k][2]});
    out.gap.push_back(gap[k]);
  }
  return out;
}

double across(const std::array<double, 3>& f) { return std::hypot(f[1], f[2]); }

/// Largest differences over stored rows, as shares: of accelerations, and of each place's force.
struct Worst {
  int rows = 0;
  double acceleration = 0.0, force = 0.0;
};
/// By what the contacts make of the accelerations, or gravity where that is less.
double share_of(const std::vector<double>& ours, const std::vector<double>& theirs, const std::vector<double>& free) {
  double most = 0.0, scale = 9.81;
  for (std::size_t j = 0; j < theirs.size(); ++j) {
    most = std::max(most, std::fabs(ours[ours.size() - theirs.size() + j] - theirs[j]));
    scale = std::max(scale, std::fabs(theirs[j] - free[j]));
  }
  return most / scale;
}
/// Of the push along the normal and the pull across, by the largest force in the row. `normals`: in world axes.
double force_share(const Answer& a, const std::vector<std::array<double, 3>>& theirs,
                   const std::vector<std::size_t>& normals) {
  double most = 0.0, scale = 1.0;
  for (std::size_t k = 0; k < theirs.size(); ++k) {
    std::array<double, 3> f = theirs[k];
    std::swap(f[0], f[normals[k]]);
    most = std::max({most, std::fabs(a.force[k][0] - std::fabs(f[0])), std::fabs(across(a.force[k]) - across(f))});
    scale = std::max(scale, std::hypot(f[0], across(f)));
  }
  return most / scale;
}

template <class Model>
void compare(const char* what, const std::string& name, const std::function<bool(const Json&)>& chosen,
             const std::vector<std::size_t>& normals, Worst& law, Worst& mujoco) {
  for (const Json& row : json_of(name + "_contacts")) {
    if (!chosen(row)) continue;
    auto state = row["q"].get<std::vector<double>>();
    const auto v = row["v"].get<std::vector<double>>();
    state.insert(state.end(), v.begin(), v.end());
    const Answer a = answer<Model>(state, row["u"].get<std::vector<double>>());
    const auto take = [&](Worst& worst, const char* rates, const char* forces) {
      ++worst.rows;
      worst.acceleration = std::max(worst.acceleration, share_of(a.rates, row[rates].get<std::vector<double>>(),
                                                                 row["a_free"].get<std::vector<double>>()));
      worst.force =
          std::max(worst.force, force_share(a, row[forces].get<std::vector<std::array<double, 3>>>(), normals));
    };
    take(law, "a_law", "force_law");
    take(mujoco, "a", "force");
  }
  std::printf(
      "%s: %d states; the law solved to its end: accelerations within %.2g, forces within %.2g; MuJoCo: %.2g, %.2g\n",
      what, law.rows, law.acceleration, law.force, mujoco.acceleration, mujoco.force);
}

bool at_the_edge(const std::vector<std::array<double, 3>>& all, const std::vector<std::size_t>& normals) {
  for (std::size_t k = 0; k < all.size(); ++k) {
    std::array<double, 3> f = all[k];
    std::swap(f[0], f[normals[k]]);
    if (across(f) > 0.79 * std::fabs(f[0]) && across(f) > 1e-3) return true;
  }
  return false;
}
/// In MuJoCo or by the law.
bool slips(const Json& row, const std::vector<std::size_t>& normals) {
  for (const char* forces : {"force", "force_law"})
    if (at_the_edge(row[forces].get<std::vector<std::array<double, 3>>>(), normals)) return true;
  return false;
}

const std::vector<std::size_t> kLegNormals{2}, kHandNormals{1, 1, 2};

// The differences are the file's, not the equations': MuJoCo softens by an estimate of how a place yields that it makes
// once, and leaves out what turning joints add to a place's acceleration.
TEST(Contacts, TheLegStandsAsMuJoCosDoes) {
  Worst law, mujoco;
  compare<Leg>(
      "leg stands", "leg", [](const Json& row) { return !slips(row, kLegNormals); }, kLegNormals, law, mujoco);
  EXPECT_GT(law.rows, 50);
  EXPECT_LT(law.acceleration, 0.002);
  EXPECT_LT(law.force, 0.002);
  EXPECT_LT(mujoco.force, 0.05);
  EXPECT_LT(mujoco.acceleration, 0.1);
}
// A sliding place of MuJoCo is pushed off the ground: its cone of friction is convex, and the force in it is the one
// that takes most from the motion. Coulomb's law, which the model has, does not do that.
TEST(Contacts, TheLegSlidesByCoulombsLaw) {
  Worst law, mujoco;
  compare<Leg>(
      "leg slides", "leg", [](const Json& row) { return slips(row, kLegNormals); }, kLegNormals, law, mujoco);
  EXPECT_GT(law.rows, 5);
  EXPECT_LT(law.acceleration, 0.005);
  EXPECT_LT(law.force, 0.005);
}
TEST(Contacts, TheGripperHoldsAsMuJoCosDoes) {
  Worst law, mujoco;
  compare<Hand>(
      "gripper holds", "gripper", [](const Json& row) { return !slips(row, kHandNormals); }, kHandNormals, law, mujoco);
  EXPECT_GT(law.rows, 50);
  EXPECT_LT(law.acceleration, 0.02);
  EXPECT_LT(law.force, 0.02);
  EXPECT_LT(mujoco.force, 0.05);
  EXPECT_LT(mujoco.acceleration, 0.05);
}
// Three rounds through the places leave a difference where one slides while another sticks.
TEST(Contacts, TheGripperLetsSlide) {
  Worst law, mujoco;
  compare<Hand>(
      "gripper slides", "gripper", [](const Json& row) { return slips(row, kHandNormals); }, kHandNormals, law, mujoco);
  EXPECT_GT(law.rows, 5);
  EXPECT_LT(law.acceleration, 0.3);
  EXPECT_LT(law.force, 0.3);
}

/// A step of the midpoint rule; what the places feel in its middle.
Answer step(std::vector<double>& x, const std::vector<double>& u, double step_s) {
  const Answer begin = answer<Hand>(x, u);
  std::vector<double> middle = x;
  for (std::size_t i = 0; i < x.size(); ++i) middle[i] += 0.5 * step_s * begin.rates[i];
  const Answer half = answer<Hand>(middle, u);
  for (std::size_t i = 0; i < x.size(); ++i) x[i] += step_s * half.rates[i];
  return half;
}
constexpr double kPalm_N = 9.81 * (0.5 + 2.0 * 0.065);  // the palm stays

/// The box alone: what it does to the table until it rests.
struct Drop {
  double peak_N = 0.0, rebound_m_s = 0.0, rest_N = 0.0, rest_m = 0.0;
};
Drop drop(double step_s) {
  std::vector<double> x{0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0};
  Drop out;
  bool has_landed = false;
  for (int k = 0; k * step_s < 0.5; ++k) {
    const Answer half = step(x, {kPalm_N, 0.0}, step_s);
    has_landed = has_landed || half.force[2][0] > 1.0;
    out.peak_N = std::max(out.peak_N, half.force[2][0]);
    if (has_landed) out.rebound_m_s = std::max(out.rebound_m_s, x[7]);
    out.rest_N = half.force[2][0];
  }
  out.rest_m = x[3];
  return out;
}
// What the guide says of steps: the box, struck aside between closed fingers on the table, rests at all up to settle_s.
TEST(Contacts, StepsUpToTheSettlingTimeComeToRest) {
  const auto unrest = [](double step_s) {
    std::vector<double> x{0.0, 0.021, 0.0003, 0.0, 0.0, 0.0, 0.05, 0.0};
    for (int k = 0; k < 400; ++k) (void)step(x, {kPalm_N, 5.0}, step_s);
    return *std::max_element(x.begin() + 4, x.end(), [](double a, double b) { return std::fabs(a) < std::fabs(b); });
  };
  for (const double step_s : {0.002, 0.005, 0.0095}) EXPECT_LT(std::fabs(unrest(step_s)), 1e-4) << step_s;
  for (const double step_s : {0.0105, 0.012}) EXPECT_GT(std::fabs(unrest(step_s)), 1e-3) << step_s;
}
TEST(Contacts, ADropEndsAsMuJoCosDoes) {
  const Json theirs = json_of("gripper_drop");
  const double weight_N = theirs["weight_N"].get<double>(), lands_m_s = std::sqrt(2.0 * 9.81 * 0.05);
  for (const double step_s : {1e-4, 5e-3}) {  // what MuJoCo steps, and what the robot file does
    const Drop ours = drop(step_s);
    std::printf("drop at %g s: peak %.1f N (MuJoCo %.1f), rebound %.3f m/s (%.3f) of %.3f, rests at %.6f m (%.6f)\n",
                step_s, ours.peak_N, theirs["peak_N"].get<double>(), ours.rebound_m_s,
                theirs["rebound_m_s"].get<double>(), lands_m_s, ours.rest_m, theirs["rest_m"].get<double>());
    EXPECT_NEAR(ours.rest_N, weight_N, 1e-3 * weight_N);
    EXPECT_LT(std::fabs(ours.rest_m), 1e-4);
    EXPECT_LT(ours.rebound_m_s, 0.35 * lands_m_s);
  }
  EXPECT_NEAR(drop(1e-4).peak_N, theirs["peak_N"].get<double>(), 0.15 * theirs["peak_N"].get<double>());
}

// What cannot be a contact is refused with the geom, the file and what to do.
struct Choice {
  bool good = false;
  Mechanism mechanism;
  std::string errors;
};
Choice choose(const Json& json, const Words& words) {
  Choice out;
  Description robot;
  std::vector<std::string> errors;
  EXPECT_TRUE(read_compiled_mjcf(json.dump(), "rig.xml", robot, errors));
  EXPECT_TRUE(build_mechanism(robot, {}, out.mechanism, errors)) << errors[0];
  out.good = choose_contacts(robot, words, out.mechanism, errors);
  out.errors = join(errors, "\n");
  return out;
}
Json& shape(Json& json, const std::string& name) {
  for (Json& one : json["shapes"])
    if (one["name"] == name) return one;
  ADD_FAILURE() << name;
  return json;
}

TEST(Contacts, WhatIsRefusedIsTold) {
  const Json leg = json_of("leg"), hand = json_of("gripper");
  const auto expect = [](const Choice& choice, const std::string& part) {
    EXPECT_FALSE(choice.good);
    EXPECT_NE(choice.errors.find(part), std::string::npos) << choice.errors;
  };
  expect(choose(leg, {"fot:plane"}), "--contact fot:plane: rig.xml has no geom 'fot'; is 'foot' meant?");
  expect(choose(leg, {"foot"}), "--contact foot: write GEOM:plane or GEOM:GEOM2");
  expect(choose(leg, {"foot:calf"}), "both are on one body ('calf' and 'calf')");
  expect(choose(leg, {"thigh:calf"}), "'thigh' is a capsule, 'calf' is a capsule; contacts are between");
  Json changed = leg;
  shape(changed, "foot")["type"] = "mesh";
  expect(choose(changed, {"foot:plane"}), "'foot' is a mesh, 'floor' is a plane; contacts are between");
  changed = leg;
  shape(changed, "foot")["friction"] = shape(changed, "floor")["friction"] = 0.0;
  expect(choose(changed, {"foot:plane"}), "neither geom has friction");
  changed = leg;
  shape(changed, "foot")["solref"] = shape(changed, "floor")["solref"] = {-1000.0, 0.0};
  expect(choose(changed, {"foot:plane"}), "solref has no damping");
  changed = leg;
  changed.erase("shapes");
  expect(choose(changed, {"foot:plane"}), "of rig.xml no shapes are read");
  changed = leg;
  changed["shapes"].push_back(shape(changed, "floor"));
  changed["shapes"].back()["name"] = "stair";
  expect(choose(changed, {"foot:plane"}), "the file has 2 planes; name one: floor, stair");
  expect(choose(hand, {"left_finger:box", "left_pad:nothing"}), "has no geom 'nothing'");
}

TEST(Contacts, PairsTakeMuJoCosLaw) {
  Json leg = json_of("leg");
  shape(leg, "foot")["friction"] = 0.3;
  shape(leg, "foot")["solref"] = {0.02, 0.5};
  const Choice mixed = choose(leg, {"foot:floor"});
  ASSERT_TRUE(mixed.good) << mixed.errors;
  const ContactPair& pair = mixed.mechanism.contacts[0];
  EXPECT_EQ(pair.law.friction, 0.8) << "the larger";
  EXPECT_DOUBLE_EQ(pair.law.settle_s, 0.015) << "the mean";
  EXPECT_DOUBLE_EQ(pair.law.damping_ratio, 0.75);
  shape(leg, "foot")["priority"] = 1;
  EXPECT_EQ(choose(leg, {"foot:plane"}).mechanism.contacts[0].law.friction, 0.3) << "its own";
  // stiffness 1e4 and damping 100, per mass: 0.02 s at half of critical damping
  shape(leg, "foot")["solref"] = {-1e4, -100.0};
  const TouchLaw direct = choose(leg, {"foot:plane"}).mechanism.contacts[0].law;
  EXPECT_DOUBLE_EQ(direct.settle_s, 0.02);
  EXPECT_DOUBLE_EQ(direct.damping_ratio, 0.5);
  leg["pairs"].push_back({{"geoms", {"floor", "foot"}},
                          {"friction", 0.1},
                          {"condim", 3},
                          {"solref", {0.03, 1}},
                          {"solimp", {0.9, 0.9, 0.001, 0.5, 2}}});
  EXPECT_EQ(choose(leg, {"foot:plane"}).mechanism.contacts[0].law.friction, 0.1) << "as the file has the pair";
  // without a plane in the file the ground is z = 0
  Json bare = json_of("leg");
  shape(bare, "floor")["type"] = "box";
  EXPECT_TRUE(choose(bare, {"foot:plane"}).good);
}

TEST(Contacts, ShapesBecomePlaces) {
  Json leg = json_of("leg");
  const auto places = [](const Choice& choice) {
    EXPECT_TRUE(choice.good) << choice.errors;
    return choice.mechanism.contacts[0].points;
  };
  EXPECT_EQ(places(choose(leg, {"foot:plane"})).size(), 1u);
  EXPECT_EQ(places(choose(leg, {"calf:plane"})).size(), 2u) << "a capsule's ends";
  EXPECT_EQ(places(choose(leg, {"trunk:plane"})).size(), 1u) << "a box that cannot turn";
  shape(leg, "foot")["type"] = "box";
  shape(leg, "foot")["size"] = {0.03, 0.02, 0.01};
  const std::vector<ContactPoint> corners = places(choose(leg, {"foot:plane"}));
  ASSERT_EQ(corners.size(), 4u);
  EXPECT_EQ(corners[0].radius_m, 0.0);
  // two boxes: the smaller face lends its corners, the other one ends at its edges
  const std::vector<ContactPoint> pad = places(choose(json_of("gripper"), {"left_finger:box"}));
  ASSERT_EQ(pad.size(), 1u);
  EXPECT_GT(pad[0].half_x_m, 0.0);
  // and no more than eight places
  const Choice many = choose(leg, {"foot:plane", "calf:plane", "thigh:plane", "trunk:plane"});
  EXPECT_NE(many.errors.find("9 places of contact where a model may have 8"), std::string::npos) << many.errors;
}

/// Gaps, speeds and drifts of all places at a state, from positions and speeds of the joints.
std::vector<ContactRows<double>> rows_at(const Mechanism& mechanism, std::vector<double> q,
                                         const std::vector<double>& v, double later_s) {
  for (std::size_t i = 0; i < q.size(); ++i) q[i] += later_s * v[i];
  ArticulatedBody<double> tree(mechanism, {});
  tree.place(q);
  const BodyMotions<double> motions(mechanism, tree, v);
  std::vector<ContactRows<double>> out;
  for (const ContactPair& pair : mechanism.contacts)
    for (const ContactPoint& place : pair.points) out.push_back(motions.rows(place));
  return out;
}

// The places' kinematics against differences in time: on the ground, on faces and spheres that turn, at corners.
TEST(Contacts, PlacesMoveAsTheirGapsDo) {
  Json leg = json_of("leg");
  const auto add = [&](const char* name, const char* body, const char* type, const Json& pos, const Json& size) {
    Json one = shape(leg, "foot");
    one["name"] = name;
    one["body"] = body;
    one["type"] = type;
    one["pos"] = pos;
    one["size"] = size;
    one["quat"] = {0.9, 0.1, 0.3, -0.2};
    leg["shapes"].push_back(one);
  };
  add("knob", "trunk", "sphere", {0.15, 0.02, -0.1}, {0.03, 0, 0});
  add("slab", "thigh", "box", {0.01, 0, -0.1}, {0.02, 0.03, 0.1});
  add("bead", "calf", "sphere", {0.01, 0.03, -0.05}, {0.02, 0, 0});
  add("heel", "calf", "box", {0, 0, -0.2}, {0.03, 0.02, 0.01});
  const Choice choice = choose(leg, {"foot:plane", "knob:slab", "bead:knob", "heel:plane"});
  ASSERT_TRUE(choice.good) << choice.errors;
  const std::vector<double> q{0.03, 0.6, -1.3}, v{0.7, -2.0, 3.0};
  constexpr double kStep_s = 1e-5;
  const auto now = rows_at(choice.mechanism, q, v, 0.0), before = rows_at(choice.mechanism, q, v, -kStep_s),
             after = rows_at(choice.mechanism, q, v, kStep_s);
  ASSERT_EQ(now.size(), 7u);
  for (std::size_t i = 0; i < now.size(); ++i) {
    EXPECT_NEAR(now[i].speed[0], (after[i].gap - before[i].gap) / (2 * kStep_s), 1e-7) << i;
    const bool is_ball = i == 2;  // whose tangents turn with the line of centres, which is left out
    for (std::size_t k = 0; k < (is_ball ? 1u : 3u); ++k) {
      EXPECT_NEAR(now[i].drift[k], (after[i].speed[k] - before[i].speed[k]) / (2 * kStep_s), 1e-5) << i << " " << k;
      double speed = 0.0;
      for (std::size_t j = 0; j < v.size(); ++j) speed += now[i].reach[k][j] * v[j];
      EXPECT_NEAR(now[i].speed[k], speed, 1e-12) << i << " " << k;
    }
  }
}

TEST(Contacts, TheStepFollowsTheFastestContact) {
  Choice leg = choose(json_of("leg"), {"foot:plane"});
  EXPECT_EQ(contact_substeps(leg.mechanism, 0.01), 2u);
  leg.mechanism.contacts[0].law.settle_s = 0.002;
  EXPECT_EQ(contact_substeps(leg.mechanism, 0.01), 10u);
  leg.mechanism.contacts[0].law.damping_ratio = 0.25;
  EXPECT_EQ(contact_substeps(leg.mechanism, 0.01), 20u);
  leg.mechanism.contacts[0].law.settle_s = 0.0002;
  EXPECT_EQ(contact_substeps(leg.mechanism, 0.01), 0u);
}

// The friction is known, or the prior's where it is asked for; the law's times stay.
TEST(Contacts, FrictionMayBeUnknown) {
  const Choice leg = choose(json_of("leg"), {"foot:plane"});
  Unknowns unknowns;
  std::vector<std::string> errors;
  ASSERT_TRUE(read_unknowns({}, leg.mechanism, unknowns, errors));
  ASSERT_EQ(unknowns.parameters.size(), 3u);
  EXPECT_EQ(unknowns.parameters[0].name, "foot_friction");
  EXPECT_EQ(unknowns.parameters[0].prior(), "0.8");
  ASSERT_TRUE(read_unknowns({"contact:foot"}, leg.mechanism, unknowns, errors));
  EXPECT_EQ(unknowns.parameters[0].prior(), "{ log_normal = [0.8, 0.25] }");
  EXPECT_EQ(unknowns.parameters[1].prior(), "0.01");
  EXPECT_FALSE(read_unknowns({"contact:hand"}, leg.mechanism, unknowns, errors));
  EXPECT_EQ(errors.back(), "--unknown contact:hand: no contact of --contact is called 'hand'; there are foot");
}

}  // namespace
}  // namespace tiller::tools
