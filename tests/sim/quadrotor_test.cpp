#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "plants.hpp"
#include "rollout/rollout.hpp"

// The plant in space: closed formulas, and the shipped model's equations beside ODE's at random states. The model and
// the plant share no text.

namespace tiller::sim {
namespace {

constexpr double g = 9.81;
constexpr double mass = 0.8;  // the plant's own default
const char* const kStates[] = {"x_m",   "y_m",   "z_m",   "attitude_w", "attitude_x",  "attitude_y", "attitude_z",
                               "x_m_s", "y_m_s", "z_m_s", "roll_rad_s", "pitch_rad_s", "yaw_rad_s"};

PlantOptions quadrotor() {
  PlantOptions o;
  o.kind = "quadrotor";
  o.watchdog_timeout_s = 0;
  return o;
}

void thrust(Plant& plant, double front_left_N, double front_right_N, double rear_left_N, double rear_right_N) {
  const double all[] = {front_left_N, front_right_N, rear_left_N, rear_right_N};
  plant.apply(all);
}

TEST(Quadrotor, FallsAndHovers) {
  auto falling = make(quadrotor());
  falling->advance(1.0);
  EXPECT_NEAR(truth(*falling)[2], -g / 2, 1e-9);  // a parabola, which second-order steps follow exactly
  auto hovering = make(quadrotor());
  thrust(*hovering, mass * g / 4, mass * g / 4, mass * g / 4, mass * g / 4);
  hovering->advance(5.0);
  const auto x = truth(*hovering);
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(x[i], i == 3 ? 1 : 0, 1e-9) << kStates[i];
}

TEST(Quadrotor, EachPairOfRotorsTurnsItItsOwnWay) {
  const auto rates = [](double fl, double fr, double rl, double rr) {
    auto plant = make(quadrotor());
    thrust(*plant, fl, fr, rl, rr);
    plant->advance(0.001);
    const auto x = truth(*plant);
    return std::array<double, 3>{x[10], x[11], x[12]};
  };
  const auto roll = rates(1, 0, 1, 0), pitch = rates(0, 0, 1, 1), yaw = rates(1, 0, 0, 1);
  EXPECT_GT(roll[0], 0);   // the left side rises: a turn about x, forward
  EXPECT_GT(pitch[1], 0);  // the tail rises: a turn about y, to the left
  EXPECT_GT(yaw[2], 0);    // clockwise rotors turn the body counter-clockwise
  for (const auto& [turn, axis] : {std::pair{roll, 0}, std::pair{pitch, 1}, std::pair{yaw, 2}})
    for (int i = 0; i < 3; ++i)
      if (i != axis) {
        EXPECT_NEAR(turn[static_cast<std::size_t>(i)], 0, 1e-12);
      }
}

// A free body that spins about its middle axis tumbles; energy and the length of its angular momentum stay.
TEST(Quadrotor, TumblesUnderNoTorque) {
  PlantOptions o = quadrotor();
  o.parameters = {
      {"gravity_m_s2", 0.0}, {"inertia_x_kgm2", 0.003}, {"inertia_y_kgm2", 0.005}, {"inertia_z_kgm2", 0.009}};
  o.initial_state = {{"roll_rad_s", 0.05}, {"pitch_rad_s", 5.0}, {"yaw_rad_s", 0.05}};
  auto plant = make(o);
  const auto momentum = [&] {
    const auto x = truth(*plant);
    return std::hypot(0.003 * x[10], 0.005 * x[11], 0.009 * x[12]);
  };
  const double before = momentum();
  bool upside_down = false;
  for (int k = 0; k < 40; ++k) {
    plant->advance(0.1);
    upside_down = upside_down || truth(*plant)[11] < -4;
  }
  EXPECT_TRUE(upside_down) << "the middle axis is not stable";
  EXPECT_NEAR(momentum(), before, 1e-5 * before);
}

TEST(Quadrotor, ItsQuaternionGoesOnWithoutJumps) {
  PlantOptions o = quadrotor();
  o.initial_state = {{"attitude_w", 0.6}, {"attitude_z", -0.8}, {"yaw_rad_s", 20.0}, {"roll_rad_s", 3.0}};
  auto plant = make(o);
  auto last = truth(*plant);
  for (int k = 0; k < 500; ++k) {
    plant->advance(0.002);
    const auto x = truth(*plant);
    double moved = 0, square = 0;
    for (std::size_t i = 3; i < 7; ++i) {
      moved += std::pow(x[i] - last[i], 2);
      square += x[i] * x[i];
    }
    EXPECT_NEAR(square, 1, 1e-12);
    EXPECT_LT(std::sqrt(moved), 0.5 * 0.002 * 25);  // half the angle that it turns
    last = x;
  }
}

// One short step of the plant from random states, attitudes of every kind among them: the change of its rates over the
// step is the model's acceleration, to the first order in it.
TEST(Quadrotor, AcceleratesAsTheModelSays) {
  const tiller_model_t& model = *tiller_find_model("quadrotor");
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  constexpr double h = 1e-6;
  double worst = 0;
  for (int trial = 0; trial < 200; ++trial) {
    double x[13], u[4], dx[13];
    const double f[6] = {}, p[] = {0.8, 0.17, 0.004, 0.005, 0.009, 0.016, 0.3};
    for (double& v : x) v = normal(random);
    const double length = std::sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5] + x[6] * x[6]);
    for (int i = 3; i < 7; ++i) x[i] /= length;
    for (double& v : u) v = std::fabs(2 + normal(random));
    PlantOptions o = quadrotor();
    o.step_s = h;
    o.parameters = {{"inertia_x_kgm2", p[2]}, {"drag_Ns_m", p[6]}};
    for (std::size_t i = 0; i < 13; ++i) o.initial_state[kStates[i]] = x[i];
    auto plant = make(o);
    thrust(*plant, u[0], u[1], u[2], u[3]);
    plant->advance(h);
    const auto after = truth(*plant);
    const tiller_body_t body = {0.0, -g, 0.0, 0.0};
    model.dynamics(x, u, f, &body, p, dx);
    for (std::size_t i = 0; i < 13; ++i) {
      const double off = std::fabs((after[i] - x[i]) / h - dx[i]) / (1 + std::fabs(dx[i]));
      worst = std::fmax(worst, off);
      EXPECT_LT(off, 2e-4) << kStates[i] << " in trial " << trial;
    }
  }
  std::printf("largest difference %.1e of the rate\n", worst);
}

}  // namespace
}  // namespace tiller::sim
