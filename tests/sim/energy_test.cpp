#include <cmath>

#include "plants.hpp"

// Without friction and motor a plant keeps its energy, up to the error of a first-order integrator: with
// bodies that accelerate at a and move at v, one step of h misplaces the energy by about m a v h / 2, and
// the error swings with the motion instead of adding up.

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

void expect_first_order(const PlantOptions& options, double bound_J) {
  const double coarse = worst_energy_error_J(options, 0.001);
  const double fine = worst_energy_error_J(options, 0.0005);
  std::printf("energy error over 10 s: %.3e J at 1 ms, %.3e J at 0.5 ms\n", coarse, fine);
  EXPECT_LT(coarse, bound_J);
  EXPECT_GT(fine, 0);
  // halves with the step; second-order terms are below h times the fastest rate, 1 %, and 10 % is generous
  EXPECT_NEAR(coarse / fine, 2.0, 0.2);
}

TEST(Energy, PendulumKeepsIt) {
  PlantOptions o = pendulum();
  o.initial_state["angle_rad"] = 2.0;
  // m = 0.5, l = 0.5, g = 9.81: falls by 0.71 m, so v <= 3.73 m/s and a <= g along the path;
  // m g v h / 2 = 0.5 * 9.81 * 3.73 * 0.001 / 2 = 9.2e-3 J
  expect_first_order(o, 9.2e-3);
}

TEST(Energy, CartPoleKeepsIt) {
  PlantOptions o = cart_pole();
  o.initial_state["angle_rad"] = 2.0;
  // rod of 0.1 kg, its centre falls by 0.29 m: v <= 2.4 m/s; 0.1 * 9.81 * 2.4 * 0.001 / 2 = 1.2e-3 J
  expect_first_order(o, 1.2e-3);
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
  // semi-implicit steps count the force on the new velocity: off by F a h / 2 per step of a = 2.7 m/s^2,
  // 1 s of them: 3 * 2.7 * 0.0005 / 2 = 2e-3 J per second, and the rod's own error as above
  EXPECT_GT(gained, 3.0);
  EXPECT_NEAR(gained, work, 5e-3);
}

}  // namespace
}  // namespace tiller::sim
