// Contacts of imported robots: accelerations and forces beside MuJoCo's, which are stored (contacts_test.py --write), and
// beside the same law solved to its end from MuJoCo's own matrices; what a drop and a rest come to; what is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "gripper.hpp"  // as imported
#include "leg_rig.hpp"
#include "tools/description/description.hpp"
#include "tools/import/contact_choice.hpp"
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
double share_of(const std::vector<double>& ours, const std::vector<double>& theirs) {
  double most = 0.0, scale = 9.81;
  for (std::size_t j = 0; j < theirs.size(); ++j) {
    most = std::max(most, std::fabs(ours[ours.size() - theirs.size() + j] - theirs[j]));
    scale = std::max(scale, std::fabs(theirs[j]));
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
void compare(const std::string& name, const std::vector<std::size_t>& normals,
             const std::function<bool(const Json&)>& chosen, Worst& law, Worst& mujoco) {
  for (const Json& row : json_of(name + "_contacts")) {
    if (!chosen(row)) continue;
    auto state = row["q"].get<std::vector<double>>();
    const auto v = row["v"].get<std::vector<double>>();
    state.insert(state.end(), v.begin(), v.end());
    const Answer a = answer<Model>(state, row["u"].get<std::vector<double>>());
    const auto take = [&](Worst& worst, const char* rates, const char* forces) {
      ++worst.rows;
      worst.acceleration = std::max(worst.acceleration, share_of(a.rates, row[rates].get<std::vector<double>>()));
      worst.force = std::max(
          worst.force, force_share(a, row[forces].get<std::vector<std::array<double, 3>>>(), normals));
    };
    take(law, "a_law", "force_law");
    take(mujoco, "a", "force");
  }
  std::printf("%s: %d states; the law solved to its end: accelerations within %.2g, forces within %.2g; MuJoCo: %.2g, %.2g\n",
              name.c_str(), law.rows, law.acceleration, law.force, mujoco.acceleration, mujoco.force);
}

bool slips(const Json& row, const char* forces, const std::vector<std::size_t>& normals) {
  const auto all = row[forces].get<std::vector<std::array<double, 3>>>();
  for (std::size_t k = 0; k < all.size(); ++k) {
    std::array<double, 3> f = all[k];
    std::swap(f[0], f[normals[k]]);
    if (across(f) > 0.79 * std::fabs(f[0]) && across(f) > 1e-3) return true;
  }
  return false;
}

const std::vector<std::size_t> kLegNormals{2}, kHandNormals{1, 1, 2};

TEST(Contacts, TheLegStandsAsMuJoCosDoes) {
  Worst law, mujoco;
  compare<Leg>("leg", kLegNormals, [](const Json& row) { return !slips(row, "force", kLegNormals); }, law, mujoco);
  EXPECT_GT(law.rows, 20);
}
TEST(Contacts, TheLegSlides) {
  Worst law, mujoco;
  compare<Leg>("leg", kLegNormals, [](const Json& row) { return slips(row, "force_law", kLegNormals); }, law, mujoco);
  EXPECT_GT(law.rows, 5);
}
TEST(Contacts, TheGripperHoldsAsMuJoCosDoes) {
  Worst law, mujoco;
  compare<Hand>("gripper", kHandNormals, [](const Json& row) { return !slips(row, "force", kHandNormals); }, law, mujoco);
  EXPECT_GT(law.rows, 20);
}
TEST(Contacts, TheGripperLetsSlide) {
  Worst law, mujoco;
  compare<Hand>("gripper", kHandNormals, [](const Json& row) { return slips(row, "force_law", kHandNormals); }, law, mujoco);
  EXPECT_GT(law.rows, 5);
}

}  // namespace
}  // namespace tiller::tools
