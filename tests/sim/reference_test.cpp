#include <array>
#include <cmath>

#include "plants.hpp"

// The cart-pole of bodies and joints against its equations of motion, written out here from the Lagrangian
//   L = (M + m) v^2 / 2 + m l v w cos a + (2/3) m l^2 w^2 - m g l cos a
// with the cart's velocity v, the rod's lean a from upright, its rate w, and a rod of length 2 l:
//   (M + m) v' + m l (w' cos a - w^2 sin a) = F - b v
//   (4/3) l w' + v' cos a = g sin a

namespace tiller::sim {
namespace {

struct Parameters {
  double M, m, l, b;
};
using State = std::array<double, 4>;  // position, angle, velocity, rate

State derivative(const State& x, double F, const Parameters& p) {
  const double c = std::cos(x[1]), s = std::sin(x[1]), g = 9.81;
  // the two equations as a linear system in (v', w'), solved by Cramer's rule
  const double a11 = p.M + p.m, a12 = p.m * p.l * c, r1 = F - p.b * x[2] + p.m * p.l * x[3] * x[3] * s;
  const double a21 = c, a22 = 4.0 / 3.0 * p.l, r2 = g * s;
  const double det = a11 * a22 - a12 * a21;
  return {x[2], x[3], (r1 * a22 - a12 * r2) / det, (a11 * r2 - a21 * r1) / det};
}

State along(const State& x, double h, const State& d) {
  return {x[0] + h * d[0], x[1] + h * d[1], x[2] + h * d[2], x[3] + h * d[3]};
}

State rk4(const State& x, double h, double F, const Parameters& p) {
  const State a = derivative(x, F, p), b = derivative(along(x, h / 2, a), F, p);
  const State c = derivative(along(x, h / 2, b), F, p), d = derivative(along(x, h, c), F, p);
  State y = x;
  for (std::size_t i = 0; i < 4; ++i) y[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
  return y;
}

double force_at(int tick) { return 4 * std::sin(0.11 * tick) + 2 * std::sin(0.033 * tick + 1); }

/// Largest difference of any state over 2 s of a force that changes every 10 ms.
double worst_difference(const Parameters& p, const State& start, double step_s) {
  PlantOptions o = cart_pole();
  o.step_s = step_s;
  o.parameters = {{"cart_mass_kg", p.M}, {"pole_mass_kg", p.m}, {"half_length_m", p.l}, {"cart_friction_Ns_m", p.b}};
  o.initial_state = {
      {"position_m", start[0]}, {"angle_rad", start[1]}, {"velocity_m_s", start[2]}, {"rate_rad_s", start[3]}};
  auto plant = make(o);
  State x = start;
  double worst = 0;
  for (int tick = 0; tick < 200; ++tick) {
    command(*plant, force_at(tick));
    plant->advance(0.01);
    for (int k = 0; k < 100; ++k) x = rk4(x, 1e-4, force_at(tick), p);
    const auto y = truth(*plant);
    for (std::size_t i = 0; i < 4; ++i) worst = std::fmax(worst, std::fabs(x[i] - y[i]));
  }
  return worst;
}

TEST(Reference, CartPoleFollowsItsLagrangian) {
  const Parameters sets[] = {{1.0, 0.1, 0.5, 0.0}, {0.7, 0.25, 0.3, 0.8}, {2.0, 0.5, 0.9, 0.2}};
  const State starts[] = {{0, 3.141592653589793, 0, 0}, {0.2, 2.2, -0.5, 1.5}, {0, 0.3, 0.3, -1}};
  for (const Parameters& p : sets) {
    for (const State& start : starts) {
      const double coarse = worst_difference(p, start, 0.001);
      const double fine = worst_difference(p, start, 0.0005);
      std::printf("M %.2f m %.2f l %.2f b %.2f from %.2f rad: %.2e at 1 ms, %.2e at 0.5 ms, ratio %.2f\n", p.M, p.m,
                  p.l, p.b, start[1], coarse, fine, coarse / fine);
      // second order: rates of up to 14 rad/s where the rod whips through, times (14 h)^2 / 12 = 6e-5 at 0.5 ms
      EXPECT_LT(fine, 6e-5);
      // only discretisation may separate the two, so the difference falls with the square of the step
      EXPECT_NEAR(coarse / fine, 4, 0.2);
    }
  }
}

}  // namespace
}  // namespace tiller::sim
