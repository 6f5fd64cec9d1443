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
      value += now[i].mass_kg *
               (0.5 * (vx * vx + vy * vy + vz * vz) + body.gravity_x_m_s2 * now[i].x + body.gravity_z_m_s2 * now[i].z);
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
      const double need = (robot.momentum(after_q, after_v, j) - robot.momentum(before_q, before_v, j)) / (2 * h) -
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

// Accelerations by MuJoCo 3 (mj_forward) of the same robot in its terms: two hinges, a mass at the tip. A state,
// torques of motor and effects, gravity, payload, parameters; then what came out.
TEST(Furuta, AcceleratesAsMuJoCoSays) {
  struct Row {
    double in[18], out[2];
  };
  const Row rows[] = {
      {{-0.1683, -2.0692, -4.8571, -6.3054, -0.1225, 0.0628, -0.0154, -0.7635, -10.5961, 0, 0, 0.1317, 0.0099, 0.0098,
        0.2408, 0.361, 0.1087, 0.0006},
       {-10.3507776924491, 71.659115344585}},
      {{-0.8535, 0.9338, -0.9547, 2.1466, -0.1108, -0.0732, -0.0341, -1.9107, -10.0207, 0.0569, 0, 0.114, 0.0063,
        0.0141, 0.2011, 0.3734, 0.0725, 0.0005},
       {-5.76077003239397, -35.3249539311722}},
      {{-3.0498, -0.9998, 0.0451, 4.9445, -0.0756, -0.01, -0.0448, 1.3206, -8.8325, 0, 0, 0.074, 0.0043, 0.0119, 0.2213,
        0.3601, 0.0578, 0.001},
       {-19.7908939017872, 35.1947114988662}},
      {{-3.481, -1.0214, -1.9244, -0.2244, -0.1721, 0.0431, -0.0362, -2.1909, -10.2966, 0.1222, 0.0005, 0.1623, 0.0056,
        0.0135, 0.2172, 0.1725, 0.1446, 0.0003},
       {-10.3675185319668, 53.1127678550362}},
  };
  const tiller_model_t& m = *tiller_find_model("furuta");
  for (const Row& row : rows) {
    const tiller_body_t body = {row.in[7], row.in[8], row.in[9], row.in[10]};
    double dx[4];
    m.dynamics(row.in, row.in + 4, row.in + 5, &body, row.in + 11, dx);
    const double size = std::max(std::fabs(row.out[0]), std::fabs(row.out[1]));
    for (int i = 0; i < 2; ++i) EXPECT_NEAR(dx[2 + i], row.out[i], 1e-12 * size);  // its 15 digits
  }
}

}  // namespace
}  // namespace tiller
