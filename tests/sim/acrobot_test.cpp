#include <array>
#include <cmath>

#include "plants.hpp"

// The acrobot of bodies and joints against its equations of motion, written out here from the Lagrangian with the
// upper rod's angle a from hanging, the lower rod's angle b against the upper one, and
//   A = I1 + m1 c1^2 + m2 l1^2, B = I2 + m2 c2^2, H = m2 l1 c2:
//   (A + B + 2 H cos b) a'' + (B + H cos b) b'' - H sin b (2 a' b' + b'^2) + g (m1 c1 + m2 l1) sin a + g m2 c2 sin(a+b)
//   = 0 (B + H cos b) a'' + B b'' + H sin b a'^2 + g m2 c2 sin(a + b) = torque

namespace tiller::sim {
namespace {

constexpr double pi = 3.141592653589793;
constexpr double g = 9.81;
using State = std::array<double, 4>;  // shoulder, elbow, their rates

struct Rods {
  double m1 = 1.0, m2 = 1.0, l1 = 0.5, c1 = 0.25, c2 = 0.25, I1 = 1.0 / 48, I2 = 1.0 / 48;
  double A() const { return I1 + m1 * c1 * c1 + m2 * l1 * l1; }
  double B() const { return I2 + m2 * c2 * c2; }
  double H() const { return m2 * l1 * c2; }
};

PlantOptions acrobot(const Rods& r, const State& start) {
  PlantOptions o;
  o.kind = "acrobot";
  o.watchdog_timeout_s = 0;
  o.parameters = {{"upper_mass_kg", r.m1},     {"lower_mass_kg", r.m2}, {"upper_length_m", r.l1},
                  {"upper_com_m", r.c1},       {"lower_com_m", r.c2},   {"upper_inertia_kgm2", r.I1},
                  {"lower_inertia_kgm2", r.I2}};
  o.initial_state = {
      {"shoulder_rad", start[0]}, {"elbow_rad", start[1]}, {"shoulder_rad_s", start[2]}, {"elbow_rad_s", start[3]}};
  return o;
}

State derivative(const State& x, double torque, const Rods& r) {
  const double c = std::cos(x[1]), s = std::sin(x[1]), lower = g * r.m2 * r.c2 * std::sin(x[0] + x[1]);
  const double a11 = r.A() + r.B() + 2 * r.H() * c, a12 = r.B() + r.H() * c, a22 = r.B();
  const double r1 =
      r.H() * s * (2 * x[2] * x[3] + x[3] * x[3]) - g * (r.m1 * r.c1 + r.m2 * r.l1) * std::sin(x[0]) - lower;
  const double r2 = torque - r.H() * s * x[2] * x[2] - lower;
  const double det = a11 * a22 - a12 * a12;
  return {x[2], x[3], (r1 * a22 - a12 * r2) / det, (a11 * r2 - a12 * r1) / det};
}

State rk4(const State& x, double h, double torque, const Rods& r) {
  const auto along = [&x](double by, const State& d) {
    return State{x[0] + by * d[0], x[1] + by * d[1], x[2] + by * d[2], x[3] + by * d[3]};
  };
  const State a = derivative(x, torque, r), b = derivative(along(h / 2, a), torque, r);
  const State c = derivative(along(h / 2, b), torque, r), d = derivative(along(h, c), torque, r);
  State y = x;
  for (std::size_t i = 0; i < 4; ++i) y[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
  return y;
}

/// Root mean square of what the states differ by over a second of a torque that changes every 10 ms.
double mean_difference(const Rods& r, const State& start, double step_s) {
  PlantOptions o = acrobot(r, start);
  o.step_s = step_s;
  auto plant = make(o);
  State x = start;
  double sum = 0;
  for (int tick = 0; tick < 100; ++tick) {
    const double torque = 2 * std::sin(0.11 * tick) + std::sin(0.033 * tick + 1);
    command(*plant, torque);
    plant->advance(0.01);
    for (int k = 0; k < 100; ++k) x = rk4(x, 1e-4, torque, r);
    const auto y = truth(*plant);
    for (std::size_t i = 0; i < 4; ++i) sum += (x[i] - y[i]) * (x[i] - y[i]);
  }
  return std::sqrt(sum / 400);
}

TEST(Acrobot, FollowsItsLagrangian) {
  const Rods sets[] = {{}, {0.7, 1.4, 0.4, 0.15, 0.3, 0.01, 0.03}, {2.0, 0.5, 0.6, 0.35, 0.2, 0.05, 0.008}};
  const State starts[] = {{0, 0, 0, 0}, {1.2, -0.5, -0.5, 1.5}, {pi, 0.3, 0.3, -1}};
  for (const Rods& r : sets) {
    for (const State& start : starts) {
      const double coarse = mean_difference(r, start, 0.0002), fine = mean_difference(r, start, 0.0001);
      std::printf("from (%.1f, %.1f): %.2e at 0.2 ms, %.2e at 0.1 ms, ratio %.2f\n", start[0], start[1], coarse, fine,
                  coarse / fine);
      // second order: rates of up to 40 rad/s where the lower rod whips round, times (40 h)^2 / 12 = 5e-5 at 0.1 ms,
      // and twice that for what a second of swinging makes of it
      EXPECT_LT(fine, 1e-4);
      // only discretisation may separate the two, so the difference falls with the square of the step
      EXPECT_NEAR(coarse / fine, 4, 0.4);
    }
  }
}

TEST(Acrobot, SwingsInItsOwnModes) {
  const Rods r = {0.7, 1.4, 0.4, 0.15, 0.3, 0.01, 0.03};
  const double m11 = r.A() + r.B() + 2 * r.H(), m12 = r.B() + r.H(), m22 = r.B();
  const double k22 = g * r.m2 * r.c2, k11 = g * (r.m1 * r.c1 + r.m2 * r.l1) + k22, k12 = k22;
  // det(K - w^2 M) = 0
  const double a = m11 * m22 - m12 * m12, b = -(k11 * m22 + k22 * m11 - 2 * k12 * m12), c = k11 * k22 - k12 * k12;
  for (const double sign : {-1.0, 1.0}) {
    const double square = (-b + sign * std::sqrt(b * b - 4 * a * c)) / (2 * a);
    const double ratio = -(k11 - square * m11) / (k12 - square * m12);  // elbow to shoulder
    const double amplitude = 0.002;
    PlantOptions o = acrobot(r, {amplitude, amplitude * ratio, 0, 0});
    o.step_s = 0.0001;
    auto plant = make(o);
    double first = -1, last = -1, before = amplitude;
    for (int crossings = 0; crossings <= 10;) {
      plant->advance(o.step_s);
      const double now = truth(*plant)[0];
      if (before < 0 && now >= 0) {
        last = 1e-6 * static_cast<double>(plant->time_us()) - o.step_s * now / (now - before);
        if (crossings++ == 0) first = last;
      }
      before = now;
      ASSERT_LT(plant->time_us(), 60'000'000);
    }
    // 0.002 rad, a few times more at the elbow: longer by less than (0.01)^2 / 16 = 6e-6; what is left of the other
    // mode moves single crossings, not their mean over ten periods by more than 1e-4
    EXPECT_NEAR((last - first) / 10 * std::sqrt(square) / (2 * pi), 1, 1e-4) << sign;
  }
}

TEST(Acrobot, MotorPushesTheRodsApart) {
  const Rods r;
  for (const double elbow : {0.0, 1.0, 2.5}) {
    PlantOptions o = acrobot(r, {0.4, elbow, 0, 0});
    o.parameters["gravity_m_s2"] = 0;
    auto plant = make(o);
    command(*plant, 1.5);
    plant->advance(o.step_s);
    // the rates after the first step are the accelerations times the step: without gravity M^-1 (0, torque)
    const double a11 = r.A() + r.B() + 2 * r.H() * std::cos(elbow), a12 = r.B() + r.H() * std::cos(elbow);
    const double det = a11 * r.B() - a12 * a12;
    EXPECT_NEAR(truth(*plant)[2] / (o.step_s * -a12 * 1.5 / det), 1, 1e-9);
    EXPECT_NEAR(truth(*plant)[3] / (o.step_s * a11 * 1.5 / det), 1, 1e-9);
  }
}

double worst_energy_error_J(double step_s) {
  PlantOptions o = acrobot({}, {1.5, 0.5, 0, 0});
  o.step_s = step_s;
  auto plant = make(o);
  const double start = plant->energy_J();
  double worst = 0;
  for (int i = 0; i < 300; ++i) {
    plant->advance(0.01);
    worst = std::fmax(worst, std::fabs(plant->energy_J() - start));
  }
  return worst;
}

TEST(Acrobot, KeepsItsEnergy) {
  const double coarse = worst_energy_error_J(0.0002), fine = worst_energy_error_J(0.0001);
  std::printf("energy error over 3 s: %.3e J at 0.2 ms, %.3e J at 0.1 ms\n", coarse, fine);
  // 2 kg fall by about half a metre, 10 J, at up to 20 rad/s: 10 (20 h)^2 / 10 = 1.6e-5 J at 0.2 ms, and thrice that
  // where the lower rod whips round
  EXPECT_LT(coarse, 5e-5);
  EXPECT_NEAR(coarse / fine, 4.0, 0.4);
}

TEST(Acrobot, ElbowSticksUnderDryFriction) {
  PlantOptions o = acrobot({}, {0.5, 0.7, 0, 0});
  o.effects = {{"coulomb_friction", "elbow", {{"friction_SI", 50.0}}}};
  auto plant = make(o);
  plant->advance(2.0);
  EXPECT_NEAR(truth(*plant)[1], 0.7, 1e-6);  // both rods swing as one
  EXPECT_NEAR(truth(*plant)[3], 0.0, 1e-9);
}

TEST(Acrobot, TurnsAreCounted) {
  PlantOptions o = acrobot({}, {0, 0, 20, 0});
  o.parameters["gravity_m_s2"] = 0;
  auto plant = make(o);
  plant->advance(1.0);
  EXPECT_NEAR(truth(*plant)[0] + 0.5 * truth(*plant)[1], 20, 4);  // three turns, of whichever rod
  EXPECT_GT(truth(*plant)[0], 2 * pi);
}

}  // namespace
}  // namespace tiller::sim
