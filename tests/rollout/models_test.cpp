// The models' equations against mechanics written down independently: where each body is, and Lagrange's equations by
// differences.

#include <gtest/gtest.h>

#include "batch.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

/// A rigid body in the plane: position of its centre of mass, and its angle, as functions of the joints.
struct Placed {
  double x_m, z_m, angle_rad, mass_kg, inertia_kgm2;
};
using Mechanism = std::vector<Placed> (*)(const double* q, const double* p, const tiller_body_t& body);

std::vector<Placed> acrobot(const double* q, const double* p, const tiller_body_t& body) {
  const double m1 = p[0], m2 = p[1], l1 = p[2], l2 = p[3], c1 = p[4], c2 = p[5], i1 = p[6], i2 = p[7];
  const double elbow_x = l1 * std::sin(q[0]), elbow_z = -l1 * std::cos(q[0]), lower = q[0] + q[1];
  return {{c1 * std::sin(q[0]), -c1 * std::cos(q[0]), q[0], m1, i1},
          {elbow_x + c2 * std::sin(lower), elbow_z - c2 * std::cos(lower), lower, m2, i2},
          {elbow_x + l2 * std::sin(lower), elbow_z - l2 * std::cos(lower), lower, body.payload_kg, body.payload_kgm2}};
}
std::vector<Placed> quadrotor(const double* q, const double* p, const tiller_body_t& body) {
  return {{q[0], q[1], q[2], p[0] + body.payload_kg, p[2] + body.payload_kgm2}};
}

/// Kinetic and potential energy and the momenta of a mechanism with n joints.
struct Energies {
  Mechanism mechanism;
  int n;
  const double* p;
  tiller_body_t body;

  /// dL/dqdot: momenta (n); the Jacobian of the places by differences.
  std::vector<double> momenta(const std::vector<double>& q, const std::vector<double>& rate, double* kinetic) const {
    const auto places = mechanism(q.data(), p, body);
    std::vector<double> result(n, 0.0);
    if (kinetic) *kinetic = 0.0;
    std::vector<std::vector<Placed>> slope(n);
    for (int j = 0; j < n; ++j) {
      auto more = q, less = q;
      more[j] += 1e-5, less[j] -= 1e-5;
      slope[j] = mechanism(more.data(), p, body);
      const auto back = mechanism(less.data(), p, body);
      for (std::size_t b = 0; b < places.size(); ++b) {
        slope[j][b].x_m = (slope[j][b].x_m - back[b].x_m) / 2e-5;
        slope[j][b].z_m = (slope[j][b].z_m - back[b].z_m) / 2e-5;
        slope[j][b].angle_rad = (slope[j][b].angle_rad - back[b].angle_rad) / 2e-5;
      }
    }
    for (std::size_t b = 0; b < places.size(); ++b) {
      double vx = 0, vz = 0, w = 0;
      for (int j = 0; j < n; ++j) {
        vx += slope[j][b].x_m * rate[j];
        vz += slope[j][b].z_m * rate[j];
        w += slope[j][b].angle_rad * rate[j];
      }
      if (kinetic) *kinetic += 0.5 * places[b].mass_kg * (vx * vx + vz * vz) + 0.5 * places[b].inertia_kgm2 * w * w;
      for (int j = 0; j < n; ++j)
        result[j] += places[b].mass_kg * (vx * slope[j][b].x_m + vz * slope[j][b].z_m) +
                     places[b].inertia_kgm2 * w * slope[j][b].angle_rad;
    }
    return result;
  }
  double lagrangian(const std::vector<double>& q, const std::vector<double>& rate) const {
    double kinetic;
    momenta(q, rate, &kinetic);
    for (const Placed& b : mechanism(q.data(), p, body))
      kinetic += b.mass_kg * (body.gravity_x_m_s2 * b.x_m + body.gravity_z_m_s2 * b.z_m);
    return kinetic;
  }
  /// d/dt dL/dqdot - dL/dq: what the forces have to be for this motion.
  std::vector<double> forces(const std::vector<double>& q, const std::vector<double>& rate,
                             const std::vector<double>& acceleration) const {
    const double h = 1e-4;
    auto ahead = q, behind = q, faster = rate, slower = rate;
    for (int j = 0; j < n; ++j) {
      ahead[j] += h * rate[j], behind[j] -= h * rate[j];
      faster[j] += h * acceleration[j], slower[j] -= h * acceleration[j];
    }
    const auto after = momenta(ahead, faster, nullptr), before = momenta(behind, slower, nullptr);
    std::vector<double> result(n);
    for (int j = 0; j < n; ++j) {
      auto more = q, less = q;
      more[j] += h, less[j] -= h;
      result[j] = (after[j] - before[j]) / (2 * h) - (lagrangian(more, rate) - lagrangian(less, rate)) / (2 * h);
    }
    return result;
  }
};

/// Largest difference between the forces that act and those that the model's motion needs, at random points.
double worst_residual(const char* name, Mechanism mechanism, const std::vector<double>& p,
                      void (*actuators)(const double* x, const double* u, const double* p, double* force)) {
  const tiller_model_t& m = *tiller_find_model(name);
  const int n = static_cast<int>(m.joint_count);
  Rng rng(5, 96, 0);
  const auto random = [&](double size) { return size * (2.0 * rng.uniform() - 1.0); };
  double worst = 0.0;
  for (int k = 0; k < 200; ++k) {
    const tiller_body_t body = {random(3.0), -9.81 + random(1.0), k % 2 ? 0.3 * rng.uniform() : 0.0,
                                k % 2 ? 0.01 * rng.uniform() : 0.0};
    double x[TILLER_MAX_STATES], u[TILLER_MAX_INPUTS], f[TILLER_MAX_JOINTS], dx[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < m.state_count; ++i) x[i] = random(3.0);
    for (std::uint32_t i = 0; i < m.input_count; ++i) u[i] = random(4.0);
    for (int j = 0; j < n; ++j) f[j] = random(2.0);
    m.dynamics(x, u, f, &body, p.data(), dx);
    std::vector<double> q(n), rate(n), acceleration(n), force(n);
    for (int j = 0; j < n; ++j) {
      q[j] = x[m.joints[j].position];
      rate[j] = x[m.joints[j].velocity];
      acceleration[j] = dx[m.joints[j].velocity];
      force[j] = f[m.joints[j].force];
      worst = std::max(worst, std::abs(dx[m.joints[j].position] - rate[j]));
    }
    actuators(x, u, p.data(), force.data());
    const auto need = Energies{mechanism, n, p.data(), body}.forces(q, rate, acceleration);
    for (int j = 0; j < n; ++j) worst = std::max(worst, std::abs(need[j] - force[j]) / (1.0 + std::abs(need[j])));
  }
  return worst;
}

TEST(Acrobot, ObeysLagrangesEquations) {
  const auto motor = [](const double*, const double* u, const double*, double* force) { force[1] += u[0]; };
  // differences of width 1e-5 within differences of width 1e-4: truncation 1e-8 of motions up to 10 rad/s
  EXPECT_LT(worst_residual("acrobot", acrobot, {1.1, 0.8, 0.7, 0.9, 0.4, 0.5, 0.05, 0.06}, motor), 1e-5);
}

TEST(PlanarQuadrotor, ObeysLagrangesEquations) {
  const auto rotors = [](const double* x, const double* u, const double* p, double* force) {
    force[0] += -(u[0] + u[1]) * std::sin(x[2]) - p[3] * x[3];
    force[1] += (u[0] + u[1]) * std::cos(x[2]) - p[3] * x[4];
    force[2] += p[1] * (u[1] - u[0]);
  };
  EXPECT_LT(worst_residual("planar_quadrotor", quadrotor, {0.6, 0.2, 0.012, 0.15}, rotors), 1e-5);
}

std::vector<double> derivative(const char* name, std::vector<double> x, std::vector<double> u, std::vector<double> p) {
  const tiller_model_t& m = *tiller_find_model(name);
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  const double f[TILLER_MAX_JOINTS] = {};
  std::vector<double> dx(m.state_count);
  m.dynamics(x.data(), u.data(), f, &level, p.data(), dx.data());
  return dx;
}

// Points that need no formula. Two point masses of 1 kg on massless rods of 1 m.
TEST(Acrobot, AtPointsDoneByHand) {
  const std::vector<double> p = {1, 1, 1, 1, 1, 1, 0, 0};
  const double pi = 3.141592653589793;
  for (const auto& rest : {std::vector<double>{0, 0, 0, 0}, {pi, 0, 0, 0}, {0, pi, 0, 0}}) {
    const auto dx = derivative("acrobot", rest, {0.0}, p);
    for (double d : dx) EXPECT_NEAR(d, 0.0, 1e-14);
  }
  // both rods level to the right, at rest: each mass falls freely, and the lower rod stays level: q1'' + q2'' = 0
  auto dx = derivative("acrobot", {pi / 2, 0, 0, 0}, {0.0}, p);
  EXPECT_NEAR(dx[2], -9.81, 1e-12);
  EXPECT_NEAR(dx[3], 9.81, 1e-12);
  // straight down, torque T at the elbow: M = [[5, 2], [2, 1]], so q'' = T (-2, 5)
  dx = derivative("acrobot", {0, 0, 0, 0}, {0.5}, p);
  EXPECT_NEAR(dx[2], -1.0, 1e-12);
  EXPECT_NEAR(dx[3], 2.5, 1e-12);
}

TEST(PlanarQuadrotor, AtPointsDoneByHand) {
  const std::vector<double> p = {0.5, 0.2, 0.01, 0.0};
  auto dx = derivative("planar_quadrotor", {1, 2, 0, 0, 0, 0}, {0.25 * 9.81, 0.25 * 9.81}, p);
  for (double d : dx) EXPECT_NEAR(d, 0.0, 1e-14);  // hovers
  dx = derivative("planar_quadrotor", {0, 0, 1.5707963267948966, 0, 0, 0}, {1.0, 1.0}, p);
  EXPECT_NEAR(dx[3], -4.0, 1e-14);  // on its left side: 2 N to the left on 0.5 kg
  EXPECT_NEAR(dx[4], -9.81, 1e-12);
  dx = derivative("planar_quadrotor", {0, 0, 0, 0, 0, 0}, {0.0, 0.1}, p);
  EXPECT_NEAR(dx[5], 2.0, 1e-14);  // 0.1 N at 0.2 m on 0.01 kg m2, counter-clockwise
}

// A pivot turn, and a circle about a point that icr_offset keeps from going aside.
TEST(SkidSteer, AtPointsDoneByHand) {
  const std::vector<double> p = {0.1, 0.5, 0.2};
  auto dx = derivative("skid_steer", {0, 0, 0}, {2.0, 2.0}, p);
  EXPECT_NEAR(dx[0], 0.2, 1e-15);
  EXPECT_NEAR(dx[1], 0.0, 1e-15);
  EXPECT_NEAR(dx[2], 0.0, 1e-15);
  dx = derivative("skid_steer", {3, 4, 1.5707963267948966}, {-1.0, 1.0}, p);  // looks along y, turns to the left
  EXPECT_NEAR(dx[2], 0.4, 1e-15);
  EXPECT_NEAR(dx[0], 0.08, 1e-15);  // the origin, 0.2 m behind the centre, goes to the right
  EXPECT_NEAR(dx[1], 0.0, 1e-15);
}

/// The quasi-static law as conditions, not as a solution: whatever the box does has a contact force for its reason.
struct PushedBox {
  double into, along;       // force of the finger in its contact's axes, up to the limit surface's factor
  double slip, approach;    // speed of the finger against the box there: along the face, and into the box
  double depth, off_limit;  // of the finger; of the twist from the one that the force makes
};
PushedBox pushed(const std::vector<double>& x, const std::vector<double>& u, const std::vector<double>& p) {
  const auto dx = derivative("pusher_slider", x, u, p);
  const double c = std::cos(x[2]), s = std::sin(x[2]);
  const auto turned = [&](double a, double b) { return std::pair<double, double>{c * a + s * b, -s * a + c * b}; };
  const auto [qx, qy] = turned(x[3] - x[0], x[4] - x[1]);
  const auto [ux, uy] = turned(u[0], u[1]);
  const auto [fx, fy] = turned(dx[0], dx[1]);  // the limit surface: force and velocity are the same direction
  const double px = std::fmin(std::fmax(qx, -p[2]), p[2]), py = std::fmin(std::fmax(qy, -p[3]), p[3]);
  const double distance = std::hypot(qx - px, qy - py), ix = (px - qx) / distance, iy = (py - qy) / distance;
  const double vx = fx - dx[2] * py, vy = fy + dx[2] * px;  // of the box at the contact
  PushedBox b;
  b.into = fx * ix + fy * iy;
  b.along = -fx * iy + fy * ix;
  b.slip = -(ux - vx) * iy + (uy - vy) * ix;
  b.approach = (ux - vx) * ix + (uy - vy) * iy;
  b.depth = p[4] - distance;
  b.off_limit = dx[2] * p[1] * p[1] - (px * fy - py * fx);
  return b;
}

TEST(PusherSlider, EveryMotionHasAForceInTheCone) {
  Rng rng(11, 96, 0);
  const auto draw = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
  int sticks = 0, slides = 0, apart = 0;
  for (int k = 0; k < 4000; ++k) {
    const std::vector<double> p = {draw(0.05, 0.7), draw(0.025, 0.06), 0.05, 0.04, 0.01};
    // within 3 mm of a face or corner, from every side, the box at any place and angle
    const double angle = draw(-3, 3), around = draw(-3.14159, 3.14159);
    const double reach = draw(0.007, 0.013);
    const double cx = std::fmin(std::fmax(0.1 * std::cos(around), -0.05), 0.05);
    const double cy = std::fmin(std::fmax(0.1 * std::sin(around), -0.04), 0.04);
    const bool ahead = std::fabs(cx) == 0.05;
    const double qx = ahead ? cx + std::copysign(reach, cx) : cx, qy = ahead ? cy : cy + std::copysign(reach, cy);
    const double c = std::cos(angle), s = std::sin(angle), x0 = draw(-1, 1), y0 = draw(-1, 1);
    const std::vector<double> x = {x0, y0, angle, x0 + c * qx - s * qy, y0 + s * qx + c * qy};
    const std::vector<double> u = {draw(-0.05, 0.05), draw(-0.05, 0.05)};
    const PushedBox b = pushed(x, u, p);
    EXPECT_NEAR(b.off_limit, 0, 1e-12);
    if (b.into == 0 && b.along == 0) {
      ++apart;
      EXPECT_LE(b.approach + 20 * b.depth, 1e-12) << "a finger that comes nearer than 20/s of its gap pushes";
      continue;
    }
    EXPECT_GT(b.into, 0) << "no force pulls";
    EXPECT_LE(std::fabs(b.along), p[0] * b.into * (1 + 1e-12));
    EXPECT_NEAR(b.approach, -20 * b.depth, 1e-12) << "the depth goes at 20/s";
    if (std::fabs(b.slip) < 1e-12) {
      ++sticks;
    } else {
      ++slides;
      EXPECT_NEAR(std::fabs(b.along), p[0] * b.into, 1e-12) << "at the cone's edge";
      EXPECT_GT(b.along * b.slip, 0) << "the finger drags along its slip";
    }
  }
  EXPECT_GT(sticks, 400);
  EXPECT_GT(slides, 400);
  EXPECT_GT(apart, 400);
}

// Duals against differences, of f at a robot's own sizes. At a switch of modes the differences of two widths disagree:
// there the derivative is one of the two sides', and finite.
TEST(PusherSlider, DerivativesAreDifferencesAwayFromTheSwitches) {
  const tiller_model_t& m = *tiller_find_model("pusher_slider");
  ASSERT_NE(m.jacobian, nullptr);
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  Rng rng(12, 96, 0);
  const auto draw = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
  int compared = 0, states = 0;
  for (int k = 0; k < 2000; ++k) {
    const std::vector<double> p = {draw(0.05, 0.7), draw(0.025, 0.06), 0.05, 0.05, 0.01};
    std::vector<double> x = {draw(-0.01, 0.01), draw(-0.01, 0.01), draw(-0.3, 0.3), draw(-0.075, 0.075),
                             draw(-0.075, 0.075)},
                        u = {draw(-0.05, 0.05), draw(-0.05, 0.05)};
    double a[25], b[10];
    m.jacobian(x.data(), u.data(), nullptr, &level, p.data(), a, b);
    for (const double v : a) ASSERT_TRUE(std::isfinite(v)) << k;
    for (const double v : b) ASSERT_TRUE(std::isfinite(v)) << k;
    for (int j = 0; j < 7; ++j) {
      double* const at = j < 5 ? &x[j] : &u[j - 5];
      const double middle = *at;
      const auto slope = [&](double width) {
        *at = middle + width;
        auto more = derivative("pusher_slider", x, u, p);
        *at = middle - width;
        const auto less = derivative("pusher_slider", x, u, p);
        *at = middle;
        for (int i = 0; i < 5; ++i) more[i] = (more[i] - less[i]) / (2 * width);
        return more;
      };
      const auto wide = slope(2e-6), narrow = slope(1e-6);
      for (int i = 0; i < 5; ++i) {
        ++states;
        if (std::fabs(wide[i] - narrow[i]) > 1e-6 * (1 + std::fabs(narrow[i]))) continue;
        ++compared;
        EXPECT_NEAR(j < 5 ? a[i * 5 + j] : b[i * 2 + j - 5], narrow[i], 1e-5 * (1 + std::fabs(narrow[i]))) << i << j;
      }
    }
  }
  EXPECT_GT(compared, 0.99 * states);
}

// Where the centre of the finger stands on the box's rim or in its middle nothing divides by zero.
TEST(PusherSlider, IsFiniteEverywhere) {
  const tiller_model_t& m = *tiller_find_model("pusher_slider");
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  const std::vector<double> p = {0.3, 0.04, 0.05, 0.05, 0.01};
  for (const double qx : {-0.06, -0.05, 0.0, 0.05, 1e6})
    for (const double qy : {-0.05, 0.0, 1e-300, 0.05})
      for (const double v : {0.0, 0.03}) {
        const double x[5] = {0, 0, 0, qx, qy}, u[2] = {v, -v};
        double a[25], b[10], dx[5];
        m.dynamics(x, u, nullptr, &level, p.data(), dx);
        m.jacobian(x, u, nullptr, &level, p.data(), a, b);
        for (const double value : dx) EXPECT_TRUE(std::isfinite(value)) << qx << " " << qy;
        for (const double value : a) EXPECT_TRUE(std::isfinite(value)) << qx << " " << qy;
        for (const double value : b) EXPECT_TRUE(std::isfinite(value)) << qx << " " << qy;
      }
  double x[5] = {0, 0, 0, -0.05, 0}, u[2] = {0.01, 0}, dx[5];
  for (int i = 0; i < 5; ++i) {  // nothing that is not a number is lost on the way
    std::vector<double> broken = p;
    broken[i] = NAN;
    m.dynamics(x, u, nullptr, &level, broken.data(), dx);
    EXPECT_TRUE(std::isnan(dx[0]) || std::isnan(dx[1]) || std::isnan(dx[2])) << i;
  }
}

// Without torque the acrobot keeps its energy, through the kernel and its integrator.
TEST(Acrobot, KeepsItsEnergy) {
  const tiller_model_t& m = *tiller_find_model("acrobot");
  tiller::Config config = plain_config(&m);
  config.substeps = 10;
  Batch<double> b(config, 16, 250);
  std::fill(b.controls.begin(), b.controls.end(), 0.0);
  b.run(m, select_rollout(m));
  for (std::uint32_t l = 0; l < 16; ++l) {
    std::vector<double> p(8);
    for (int i = 0; i < 8; ++i) p[i] = b.params[i * 16 + l];
    const Energies energies{acrobot, 2, p.data(), config.body};
    const auto energy = [&](std::uint32_t k) {
      const auto at = [&](int i) { return b.trajectory[(k * 4 + i) * 16 + l]; };
      const std::vector<double> q = {at(0), at(1)}, rate = {at(2), at(3)};
      double kinetic;
      energies.momenta(q, rate, &kinetic);
      return 2.0 * kinetic - energies.lagrangian(q, rate);
    };
    // RK4 at 2 ms and up to 15 rad/s: (w h)^5 / 120 = 2e-10 a step, 2500 steps; the energies' differences 1e-9
    EXPECT_NEAR(energy(250), energy(0), 1e-5 * (1.0 + std::abs(energy(0)))) << l;
  }
}

}  // namespace
}  // namespace tiller
