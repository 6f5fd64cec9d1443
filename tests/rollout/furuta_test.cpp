// The Furuta pendulum against mechanics in space: where each point of mass is, and Lagrange's equations by differences.

#include <gtest/gtest.h>

#include <array>

#include "batch.hpp"

namespace tiller {
namespace {

struct Point {
  double x, y, z, mass_kg;
};

/// The pendulum as two points of mass on its own line, with its mass, centre and inertia; the arm as one at its end,
/// with its moment, whose missing inertia turns with it; the payload as a point with an inertia that turns both ways.
struct Robot {
  const double* p;
  tiller_body_t body;

  std::vector<Point> points(const double* q) const {
    const double mass = p[3], spread = std::sqrt(p[6] / mass);
    const auto on_pendulum = [&](double distance, double kg) {
      const double aside = distance * std::sin(q[1]);
      return Point{p[0] * std::cos(q[0]) - aside * std::sin(q[0]), p[0] * std::sin(q[0]) + aside * std::cos(q[0]),
                   -distance * std::cos(q[1]), kg};
    };
    return {{p[0] * std::cos(q[0]), p[0] * std::sin(q[0]), 0.0, p[2] / p[0]},
            on_pendulum(p[5] - spread, mass / 2),
            on_pendulum(p[5] + spread, mass / 2),
            on_pendulum(p[4], body.payload_kg)};
  }
  double lagrangian(const double* q, const double* v) const {
    const double h = 1e-5;
    const double ahead[] = {q[0] + h * v[0], q[1] + h * v[1]}, behind[] = {q[0] - h * v[0], q[1] - h * v[1]};
    const auto now = points(q), after = points(ahead), before = points(behind);
    double value = 0.5 * (p[1] - p[2] * p[0]) * v[0] * v[0] + 0.5 * body.payload_kgm2 * (v[0] * v[0] + v[1] * v[1]);
    for (std::size_t i = 0; i < now.size(); ++i) {
      const double vx = (after[i].x - before[i].x) / (2 * h), vy = (after[i].y - before[i].y) / (2 * h),
                   vz = (after[i].z - before[i].z) / (2 * h);
      value += now[i].mass_kg * (0.5 * (vx * vx + vy * vy + vz * vz) + body.gravity_x_m_s2 * now[i].x +
                                 body.gravity_z_m_s2 * now[i].z);
    }
    return value;
  }
  double momentum(const double* q, const double* v, int j) const {
    double more[] = {v[0], v[1]}, less[] = {v[0], v[1]};
    more[j] += 0.1, less[j] -= 0.1;  // quadratic in the rates: exact for any width
    return (lagrangian(q, more) - lagrangian(q, less)) / 0.2;
  }
};

TEST(Furuta, ObeysLagrangesEquations) {
  const tiller_model_t& m = *tiller_find_model("furuta");
  Rng rng(5, 96, 0);
  const auto random = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
  double worst = 0;
  for (int k = 0; k < 200; ++k) {
    const double p[] = {random(0.2, 0.5), random(0.1, 0.2), random(0, 0.1),   random(0.1, 0.5),
                        random(0.3, 0.8), random(0.1, 0.5), random(0.01, 0.1)};
    const tiller_body_t body = {random(-3, 3), -9.81 + random(-1, 1), k % 2 ? random(0, 0.3) : 0.0,
                                k % 2 ? random(0, 0.01) : 0.0};
    const double x[] = {random(-3, 3), random(-3, 3), random(-4, 4), random(-4, 4)}, u = random(-1, 1);
    const double f[] = {random(-1, 1), random(-1, 1)};
    double dx[4];
    m.dynamics(x, &u, f, &body, p, dx);
    const Robot robot{p, body};
    const double h = 1e-4, force[] = {u + f[0], f[1]};
    for (int j = 0; j < 2; ++j) {
      const double after_q[] = {x[0] + h * x[2], x[1] + h * x[3]}, before_q[] = {x[0] - h * x[2], x[1] - h * x[3]};
      const double after_v[] = {x[2] + h * dx[2], x[3] + h * dx[3]}, before_v[] = {x[2] - h * dx[2], x[3] - h * dx[3]};
      double more[] = {x[0], x[1]}, less[] = {x[0], x[1]};
      more[j] += h, less[j] -= h;
      const double need =
          (robot.momentum(after_q, after_v, j) - robot.momentum(before_q, before_v, j)) / (2 * h) -
          (robot.lagrangian(more, x + 2) - robot.lagrangian(less, x + 2)) / (2 * h);
      worst = std::max(worst, std::fabs(need - force[j]) / (1.0 + std::fabs(need)));
    }
  }
  // differences of width 1e-4 of motions up to 10 rad/s: truncation 1e-7, rounding 1e-16 / 1e-5 / 1e-4
  EXPECT_LT(worst, 1e-5);
}


TEST(Furuta, AtPointsDoneByHand) {
  const tiller_model_t& m = *tiller_find_model("furuta");
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  const double p[] = {0.5, 0.2, 0.1, 0.4, 1.0, 0.5, 0.1}, none[] = {0.0, 0.0};
  const auto at = [&](std::array<double, 4> x, double u) {
    std::array<double, 4> dx{};
    m.dynamics(x.data(), &u, none, &level, p, dx.data());
    return dx;
  };
  // hangs and stands
  for (const double pendulum : {0.0, 3.141592653589793}) {
    const auto dx = at({0.7, pendulum, 0.0, 0.0}, 0.0);
    EXPECT_NEAR(dx[2], 0.0, 1e-14);
    EXPECT_NEAR(dx[3], 0.0, 1e-14);
  }
  // hanging: M = [[0.2 + 0.1, 0.1], [0.1, 0.2]], so a torque of 1 Nm gives (4, -2); it swings behind the arm
  auto dx = at({0.0, 0.0, 0.0, 0.0}, 1.0);
  EXPECT_NEAR(dx[2], 4.0, 1e-12);
  EXPECT_NEAR(dx[3], -2.0, 1e-12);
  // level, at rest: it falls as a rod about its hinge, 0.4 * 9.81 * 0.5 / 0.2, and the arm feels nothing
  dx = at({0.0, 1.5707963267948966, 0.0, 0.0}, 0.0);
  EXPECT_NEAR(dx[2], 0.0, 1e-12);
  EXPECT_NEAR(dx[3], -9.81, 1e-12);
  // level, the arm turning at 2 rad/s: lifts nothing, since it already points outwards across the arm
  dx = at({0.0, 1.5707963267948966, 2.0, 0.0}, 0.0);
  EXPECT_NEAR(dx[3], -9.81, 1e-12);
  // at 45 degrees the turning arm lifts it: I sin cos w^2 = 0.2 * 0.5 * 4 against 1.962 sin 45; M by hand as above
  dx = at({0.0, 0.7853981633974483, 2.0, 0.0}, 0.0);
  const double m11 = 0.4, m12 = 0.1 * std::sqrt(0.5), m22 = 0.2, turn = 0.4 - 1.962 * std::sqrt(0.5);
  EXPECT_NEAR(dx[3], m11 * turn / (m11 * m22 - m12 * m12), 1e-12);
}

}  // namespace
}  // namespace tiller
