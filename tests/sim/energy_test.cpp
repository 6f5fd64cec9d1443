#include <cmath>

#include "plants.hpp"

// Without friction and motor a plant keeps its energy, up to the error of a symplectic integrator of second order: with
// a motion at w rad/s, one step of h misplaces the energy E by about E (w h)^2 / 10, and the error swings with the
// motion instead of adding up.

namespace tiller::sim {
namespace {

double worst_energy_error_J(PlantOptions options, double step_s) {
  options.step_s = step_s;
  auto plant = make(options);
  const double start = plant->energy_J();
  double worst = 0;
  for (int i = 0; i < 1000; ++i) {
    plant->advance(0.01);
    worst = std::fmax(worst, std::fabs(plant->energy_J() - start));
  }
  return worst;
}

void expect_second_order(const PlantOptions& options, double bound_J) {
  const double coarse = worst_energy_error_J(options, 0.001);
  const double fine = worst_energy_error_J(options, 0.0005);
  std::printf("energy error over 10 s: %.3e J at 1 ms, %.3e J at 0.5 ms\n", coarse, fine);
  EXPECT_LT(coarse, bound_J);
  EXPECT_GT(fine, 0);
  // a quarter at half the step; further terms are below (w h)^2, 1e-4, and 5 % is generous
  EXPECT_NEAR(coarse / fine, 4.0, 0.2);
}

TEST(Energy, PendulumKeepsIt) {
  PlantOptions o = pendulum();
  o.initial_state["angle_rad"] = 2.0;
  // m = 0.5, l = 0.5, g = 9.81: falls by 0.71 m, 3.5 J, at up to 7.5 rad/s: 3.5 * (7.5e-3)^2 / 10 = 2e-5 J
  expect_second_order(o, 2e-5);
}

TEST(Energy, CartPoleKeepsIt) {
  PlantOptions o = cart_pole();
  o.initial_state["angle_rad"] = 2.0;
  // a rod of 0.1 kg whose centre falls by 0.29 m, 0.28 J, at up to 5 rad/s: 0.28 * (5e-3)^2 / 10 = 7e-7 J, and as much
  // for the cart
  expect_second_order(o, 1.5e-6);
}

TEST(Energy, MotorWorkIsWhatTheBodiesGain) {
  PlantOptions o = cart_pole();
  auto plant = make(o);
  const double start = plant->energy_J();
  double work = 0, before = 0;
  command(*plant, 3.0);
  for (int i = 0; i < 2000; ++i) {
    plant->advance(o.step_s);
    const double x = truth(*plant)[0];
    work += 3.0 * (x - before);
    before = x;
  }
  const double gained = plant->energy_J() - start;
  EXPECT_GT(gained, 3.0);
  EXPECT_NEAR(gained, work, 1e-5);  // the rod's error as above, at twice the rates
}

}  // namespace
}  // namespace tiller::sim
