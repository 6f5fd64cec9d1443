// The equations that an import writes, compiled from its own output, against Newton and Euler in the world's frame.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "newton_euler.hpp"
#include "rollout/model_table.hpp"
#include "stiff_arm.hpp"  // with its gripper held, so that no joint follows another
#include "test_arm.hpp"   // as imported
#include "vague_arm.hpp"  // with a mass, an inertia, a gain and friction unknown

namespace tiller_test {
namespace {

using namespace tiller::tools;
using Values = NewtonEuler::Values;
using Arm = TestArm<double>;

constexpr int kJoints = 5;
const char* const kNames[kJoints] = {"pan", "lift", "reach", "grip", "look"};
constexpr double kRatio = -1.5, kOffset = 0.1;  // of the finger that follows

struct Point {
  double q[kJoints], v[kJoints], force[kJoints];
  Vec3<double> gravity;
};

Point random_point(std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  Point p;
  for (int j = 0; j < kJoints; ++j) {
    p.q[j] = 3.0 * unit(random);
    p.v[j] = 4.0 * unit(random);
    p.force[j] = 10.0 * unit(random);
  }
  p.gravity = {3.0 * unit(random), 0.0, -9.81 + unit(random)};
  return p;
}

/// All joints from those that have states.
Values with_mirror(const double* value, bool position) {
  Values all;
  for (int j = 0; j < kJoints; ++j) all[kNames[j]] = value[j];
  all["grip_mirror"] = kRatio * value[3] + (position ? kOffset : 0.0);
  return all;
}

class Imported : public ::testing::Test {
 protected:
  void SetUp() override {
    std::vector<std::string> errors;
    ASSERT_TRUE(read_urdf(TILLER_ARM_URDF, robot_, errors)) << (errors.empty() ? "" : errors[0]);
  }

  /// Generalised forces by virtual work: the follower's force works with the ratio.
  Eigen::VectorXd inverse(const Point& p, const Eigen::VectorXd& acceleration) const {
    const Values f = NewtonEuler(robot_).forces(with_mirror(p.q, true), with_mirror(p.v, false),
                                                with_mirror(acceleration.data(), false), p.gravity);
    Eigen::VectorXd out(kJoints);
    for (int j = 0; j < kJoints; ++j) out[j] = f.at(kNames[j]);
    out[3] += kRatio * f.at("grip_mirror");
    return out;
  }
  Eigen::MatrixXd inertia(const Point& p) const {
    const Eigen::VectorXd bias = inverse(p, Eigen::VectorXd::Zero(kJoints));
    Eigen::MatrixXd m(kJoints, kJoints);
    for (int j = 0; j < kJoints; ++j) m.col(j) = inverse(p, Eigen::VectorXd::Unit(kJoints, j)) - bias;
    return m;
  }
  Eigen::VectorXd accelerations(const Point& p) const {
    const Eigen::VectorXd force = Eigen::Map<const Eigen::VectorXd>(p.force, kJoints);
    return inertia(p).ldlt().solve(force - inverse(p, Eigen::VectorXd::Zero(kJoints)));
  }

  Description robot_;
};

template <class Model>
typename Model::State state_of(const Point& p) {
  return {p.q[0], p.q[1], p.q[2], p.q[3], p.q[4], p.v[0], p.v[1], p.v[2], p.v[3], p.v[4]};
}
tiller::Body<double> body_of(const Point& p, double payload_kg = 0.0, double payload_kgm2 = 0.0) {
  return {p.gravity[0], p.gravity[2], payload_kg, payload_kgm2};
}
constexpr double kTight = 1e-10;  // of the largest acceleration; the inertia's condition is some 1e4

void expect_same(const double* ours, const Eigen::VectorXd& theirs) {
  const double scale = theirs.cwiseAbs().maxCoeff();
  for (int j = 0; j < kJoints; ++j) EXPECT_NEAR(ours[j], theirs[j], kTight * scale) << kNames[j];
}

TEST_F(Imported, AccelerationsAreNewtonsAndEulers) {
  std::mt19937 random(1);
  for (int k = 0; k < 200; ++k) {
    const Point p = random_point(random);
    // forces from outside and from the inputs push alike
    const Arm::Input u{0.5 * p.force[0], 0.5 * p.force[1], 0.5 * p.force[2], 0.5 * p.force[3], 0.5 * p.force[4]};
    const Arm::Force f{0.5 * p.force[0], 0.5 * p.force[1], 0.5 * p.force[2], 0.5 * p.force[3], 0.5 * p.force[4]};
    const Arm::State dx = Arm::dynamics(state_of<Arm>(p), u, f, body_of(p));
    const double ours[kJoints] = {dx.pan_rad_s, dx.lift_rad_s, dx.reach_m_s, dx.grip_rad_s, dx.look_rad_s};
    expect_same(ours, accelerations(p));
    EXPECT_EQ(dx.pan_rad, p.v[0]);
    EXPECT_EQ(dx.reach_m, p.v[2]);
  }
}

TEST_F(Imported, ResponsesAreTheInverseInertia) {
  std::mt19937 random(2);
  for (int k = 0; k < 50; ++k) {
    const Point p = random_point(random);
    double column[kJoints][kJoints];
    Arm::responses(state_of<Arm>(p), body_of(p), column);
    const Eigen::MatrixXd inverse = inertia(p).inverse();
    for (int j = 0; j < kJoints; ++j) expect_same(column[j], inverse.col(j));
  }
}

// Links that stand a metre from the lens along its axes tell where these point.
TEST_F(Imported, OutputsAreTheFramesPose) {
  const char* const kAlong[3] = {"lens_x", "lens_y", "lens_z"};
  for (std::size_t k = 0; k < 3; ++k) {
    LinkText link;
    link.name = kAlong[k];
    JointText weld;
    weld.name = link.name + "_weld";
    weld.parent = "lens";
    weld.child = link.name;
    weld.origin.position[k] = 1.0;
    robot_.links.push_back(link);
    robot_.joints.push_back(weld);
  }
  std::mt19937 random(7);
  for (int k = 0; k < 50; ++k) {
    const Point p = random_point(random);
    const Values q = with_mirror(p.q, true);
    const NewtonEuler reference(robot_);
    const Arm::Output y = Arm::outputs(state_of<Arm>(p));
    const Vec3<double> origin = reference.origin_of("lens", q);
    const double ours[3] = {y.lens_x_m, y.lens_y_m, y.lens_z_m};
    const double rotation[3][3] = {{y.lens_rxx, y.lens_rxy, y.lens_rxz},
                                   {y.lens_ryx, y.lens_ryy, y.lens_ryz},
                                   {y.lens_rzx, y.lens_rzy, y.lens_rzz}};
    for (std::size_t r = 0; r < 3; ++r) {
      EXPECT_NEAR(ours[r], origin[r], 1e-13);
      for (std::size_t c = 0; c < 3; ++c)
        EXPECT_NEAR(rotation[r][c], reference.origin_of(kAlong[c], q)[r] - origin[r], 1e-13);
    }
  }
}

// A payload is a link of its own: a ball screwed to the frame that carries it, here the camera's lens.
TEST_F(Imported, APayloadIsABodyAtItsFrame) {
  constexpr double kMass = 1.3, kInertia = 0.004;
  LinkText ball{"ball", 0, true, {}};
  ball.body.mass_kg = kMass;
  for (int i = 0; i < 3; ++i) ball.body.inertia_kgm2(i, i) = kInertia;
  JointText weld;
  weld.name = "weld";
  weld.parent = "lens";
  weld.child = "ball";
  robot_.links.push_back(ball);
  robot_.joints.push_back(weld);
  std::mt19937 random(3);
  for (int k = 0; k < 50; ++k) {
    const Point p = random_point(random);
    const Arm::Force f{p.force[0], p.force[1], p.force[2], p.force[3], p.force[4]};
    const Arm::State dx = Arm::dynamics(state_of<Arm>(p), {}, f, body_of(p, kMass, kInertia));
    const double ours[kJoints] = {dx.pan_rad_s, dx.lift_rad_s, dx.reach_m_s, dx.grip_rad_s, dx.look_rad_s};
    expect_same(ours, accelerations(p));
  }
}

using Vague = VagueArm<double>;
Vague::Params vague() {
  Vague::Params p{};
  p.slide_mass_kg = 0.8;
  p.look_gain = 1.0;
  return p;
}
void accelerate(const Point& p, const Vague::Params& params, double* out) {
  const Vague::Force f{p.force[0], p.force[1], p.force[2], p.force[3], p.force[4]};
  const Vague::State dx = Vague::dynamics(state_of<Vague>(p), {}, f, body_of(p), params);
  out[0] = dx.pan_rad_s, out[1] = dx.lift_rad_s, out[2] = dx.reach_m_s, out[3] = dx.grip_rad_s, out[4] = dx.look_rad_s;
}

TEST_F(Imported, UnknownsAtTheDescriptionsValuesChangeNothing) {
  std::mt19937 random(4);
  for (int k = 0; k < 20; ++k) {
    const Point p = random_point(random);
    double ours[kJoints];
    accelerate(p, vague(), ours);
    expect_same(ours, accelerations(p));
  }
}

TEST_F(Imported, AnUnknownMassScalesItsLink) {
  Vague::Params params = vague();
  params.slide_mass_kg = 1.7;
  for (LinkText& link : robot_.links)
    if (link.name == "slide") {
      link.body.mass_kg *= 1.7 / 0.8;
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) link.body.inertia_kgm2(r, c) *= 1.7 / 0.8;
    }
  std::mt19937 random(5);
  const Point p = random_point(random);
  double ours[kJoints];
  accelerate(p, params, ours);
  expect_same(ours, accelerations(p));
}

// Of an inertia in log-Cholesky coordinates: the pseudo-inertia is deformed as the coordinates say, and what is left is
// the inertia of a body that can be (Rucker and Wensing 2022), whatever they are.
TEST_F(Imported, AnUnknownInertiaStaysThatOfABody) {
  std::mt19937 random(6);
  std::normal_distribution<double> normal(0.0, 0.4);
  for (int k = 0; k < 20; ++k) {
    Vague::Params params = vague();
    double z[10];
    for (double& v : z) v = normal(random);
    params.upper_size = z[0];
    params.upper_stretch_x = z[1], params.upper_stretch_y = z[2], params.upper_stretch_z = z[3];
    params.upper_shear_xy = z[4], params.upper_shear_yz = z[5], params.upper_shear_xz = z[6];
    params.upper_shift_x_m = 0.1 * z[7], params.upper_shift_y_m = 0.1 * z[8], params.upper_shift_z_m = 0.1 * z[9];
    // nothing but a positive definite inertia of the whole arm is known without the importer's frames
    const Point p = random_point(random);
    double column[kJoints][kJoints];
    Vague::responses(state_of<Vague>(p), body_of(p), params, column);
    Eigen::MatrixXd inverse(kJoints, kJoints);
    for (int r = 0; r < kJoints; ++r)
      for (int c = 0; c < kJoints; ++c) inverse(r, c) = column[r][c];
    EXPECT_GT(inverse.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0.0);
  }
  // a size alone multiplies mass and inertia by exp(2 size)
  Vague::Params params = vague();
  params.upper_size = 0.3;
  for (LinkText& link : robot_.links)
    if (link.name == "upper") {
      link.body.mass_kg *= std::exp(0.6);
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) link.body.inertia_kgm2(r, c) *= std::exp(0.6);
    }
  const Point p = random_point(random);
  double ours[kJoints];
  accelerate(p, params, ours);
  expect_same(ours, accelerations(p));
}

TEST_F(Imported, AnUnknownGainMultipliesItsInput) {
  std::mt19937 random(7);
  const Point p = random_point(random);
  Vague::Params params = vague();
  params.look_gain = 0.7;
  Vague::Input u{};
  u.look_Nm = 2.0;
  const Vague::State pushed = Vague::dynamics(state_of<Vague>(p), u, {}, body_of(p), params);
  Vague::Force f{};
  f.look_Nm = 1.4;
  const Vague::State same = Vague::dynamics(state_of<Vague>(p), {}, f, body_of(p), params);
  EXPECT_NEAR(pushed.look_rad_s, same.look_rad_s, 1e-10 * std::fabs(same.look_rad_s));
}

// ---- slopes
// -----------------------------------------------------------------------------------------------------------

using Stiff = StiffArm<double>;
using StiffModel = tiller::StaticModel<StiffArm>;
constexpr int kStiff = 4;

struct StiffPoint {
  double x[2 * kStiff], u[kStiff], f[kStiff], p[2];
  tiller_body_t body;
};
StiffPoint stiff_point(std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  StiffPoint s{};
  for (double& x : s.x) x = 2.0 * unit(random);
  for (double& u : s.u) u = 5.0 * unit(random);
  for (double& f : s.f) f = 5.0 * unit(random);
  s.p[0] = 0.8 + 0.3 * unit(random);
  s.p[1] = 1.0 + 0.3 * unit(random);
  s.body = {3.0 * unit(random), 0.0, 0.5, 0.002};
  s.body.gravity_z_m_s2 = -9.81;
  return s;
}
static_assert(StiffModel::kKnowsSlopes, "no joint follows another");
static_assert(!tiller::StaticModel<TestArm>::kKnowsSlopes, "one does");

TEST(Slopes, AreTheDifferencesOfTheDynamics) {
  using Table = tiller::ModelTable<StiffArm>;
  std::mt19937 random(8);
  for (int k = 0; k < 50; ++k) {
    StiffPoint s = stiff_point(random);
    double a[4 * kStiff * kStiff], b[2 * kStiff * kStiff], more[2 * kStiff], less[2 * kStiff];
    Table::jacobian(s.x, s.u, s.f, &s.body, s.p, a, b);
    double scale = 1.0;
    for (const double value : a) scale = std::max(scale, std::fabs(value));
    for (int c = 0; c < 3 * kStiff; ++c) {
      double& z = c < 2 * kStiff ? s.x[c] : s.u[c - 2 * kStiff];
      const double before = z, width = 1e-5;
      z = before + width;
      Table::dynamics(s.x, s.u, s.f, &s.body, s.p, more);
      z = before - width;
      Table::dynamics(s.x, s.u, s.f, &s.body, s.p, less);
      z = before;
      for (int i = 0; i < 2 * kStiff; ++i) {
        const double slope = c < 2 * kStiff ? a[i * 2 * kStiff + c] : b[i * kStiff + c - 2 * kStiff];
        // truncation and rounding of the differences, 1e-10 each of accelerations of some hundred
        EXPECT_NEAR(slope, (more[i] - less[i]) / (2 * width), 1e-7 * scale) << "state " << i << " by " << c;
      }
    }
  }
}

// Forces that have derivatives of their own, as effects' do, and directions that no state is: the whole chain.
TEST(Slopes, CarryEveryDirection) {
  using D = tiller::Dual<double, 3>;
  std::mt19937 random(9);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const StiffPoint s = stiff_point(random);
  double along[3][4 * kStiff];
  for (auto& row : along)
    for (double& value : row) value = unit(random);
  StiffModel::State<D> x;
  StiffModel::Input<D> u;
  StiffModel::Force<D> f;
  StiffModel::Params<D> p;
  const auto seed = [&](double value, int place) {
    D d(value);
    for (int k = 0; k < 3; ++k) d.d[k] = along[k][place];
    return d;
  };
  tiller::each(StiffModel::nx(), [&](auto i) { x[i] = seed(s.x[i], i); });
  tiller::each(StiffModel::nu(), [&](auto i) { u[i] = seed(s.u[i], 2 * kStiff + i); });
  tiller::each(StiffModel::nf(), [&](auto i) { f[i] = seed(s.f[i], 3 * kStiff + i); });
  tiller::each(StiffModel::np(), [&](auto i) { p[i] = D(s.p[i]); });
  const auto dx = StiffModel::dynamics<D>(
      x, u, f, {D(s.body.gravity_x_m_s2), D(s.body.gravity_z_m_s2), D(s.body.payload_kg), D(s.body.payload_kgm2)}, p);
  for (int k = 0; k < 3; ++k) {
    double ends[2][2 * kStiff];
    for (int way = 0; way < 2; ++way) {
      StiffPoint moved = s;
      const double width = way == 0 ? 1e-5 : -1e-5;
      for (int i = 0; i < 2 * kStiff; ++i) moved.x[i] += width * along[k][i];
      for (int i = 0; i < kStiff; ++i) moved.u[i] += width * along[k][2 * kStiff + i];
      for (int i = 0; i < kStiff; ++i) moved.f[i] += width * along[k][3 * kStiff + i];
      tiller::ModelTable<StiffArm>::dynamics(moved.x, moved.u, moved.f, &moved.body, moved.p, ends[way]);
    }
    tiller::each(StiffModel::nx(), [&](auto i) {
      const double slope = (ends[0][i] - ends[1][i]) / 2e-5;
      EXPECT_NEAR(dx[i].d[k], slope, 1e-6 * (1.0 + std::fabs(slope))) << "state " << int(i);
    });
  }
}

}  // namespace
}  // namespace tiller_test
