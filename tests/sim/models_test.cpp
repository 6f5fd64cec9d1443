// Models whose plants ODE moves in space or on a ground: both from the same state under the same commands. The plant
// has bodies, joints and contacts, the model a formula, and they share no text.

#include <cmath>
#include <cstdio>

#include "plants.hpp"
#include "tiller/tiller.h"

namespace tiller::sim {
namespace {

/// The model's state a period later: RK4 in steps of 0.05 ms.
void step_model(const tiller_model_t& m, const tiller_body_t& body, const double* p, const double* u, double period_s,
                std::vector<double>& x) {
  const int steps = static_cast<int>(std::lround(period_s / 5e-5));
  const std::size_t n = x.size();
  const double none[TILLER_MAX_JOINTS] = {}, h = period_s / steps;
  std::vector<double> k[4], at(n);
  for (auto& slope : k) slope.resize(n);
  for (int s = 0; s < steps; ++s) {
    const double share[] = {0.0, 0.5, 0.5, 1.0};
    for (int i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < n; ++j) at[j] = x[j] + (i > 0 ? share[i] * h * k[i - 1][j] : 0.0);
      m.dynamics(at.data(), u, none, &body, p, k[i].data());
    }
    for (std::size_t j = 0; j < n; ++j) x[j] += h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]);
  }
}

std::vector<double> parameters_of(const tiller_model_t& m, const Plant& plant) {
  std::vector<double> p;
  for (std::uint32_t i = 0; i < m.param_count; ++i) p.push_back(plant.parameter(m.param_names[i]));
  return p;
}

/// Largest distance of the states after each of `periods` periods of 10 ms.
double apart(const PlantOptions& o, const tiller_body_t& body, int periods, double torque_Nm) {
  const tiller_model_t& m = *tiller_find_model(o.kind.c_str());
  auto plant = make(o);
  const auto p = parameters_of(m, *plant);
  auto x = truth(*plant);
  double most = 0;
  for (int k = 0; k < periods; ++k) {
    std::vector<double> u(m.input_count);
    for (std::size_t i = 0; i < u.size(); ++i) u[i] = torque_Nm * std::sin(0.13 * k + static_cast<double>(i));
    plant->apply(u.data());
    plant->advance(0.01);
    step_model(m, body, p.data(), u.data(), 0.01, x);
    const auto y = truth(*plant);
    for (std::size_t i = 0; i < x.size(); ++i) most = std::max(most, std::fabs(x[i] - y[i]));
  }
  return most;
}

PlantOptions furuta(double step_s) {
  PlantOptions o;
  o.kind = "furuta";
  o.step_s = step_s;
  o.watchdog_timeout_s = 0;
  o.initial_state = {{"arm_rad", 0.4}, {"pendulum_rad", 2.0}, {"arm_rad_s", -3.0}, {"pendulum_rad_s", 4.0}};
  return o;
}

// A twin whose step shows is a robot with other physics: at 5 rad/s, ODE's own steps at 0.5 ms act as 1 % of damping.
TEST(PendulumPlant, MovesAsTheEquationsSayAtItsDefaultStep) {
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  PlantOptions o = pendulum();
  o.parameters = {{"mass_kg", 0.3}, {"length_m", 0.4}, {"damping_Nms", 0.02}};
  o.initial_state = {{"angle_rad", 2.5}, {"rate_rad_s", -4.0}};
  EXPECT_LT(apart(o, level, 500, 0.6), 1e-4);  // of 2e-3 rad of sensor noise, over 5 s
}

TEST(FurutaPlant, MovesAsTheEquationsSay) {
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  const double coarse = apart(furuta(1e-3), level, 100, 0.01), fine = apart(furuta(2.5e-4), level, 100, 0.01);
  // a second at up to 25 rad/s; second order: a quarter of the step, a sixteenth of the error
  EXPECT_LT(fine, 5e-4);
  EXPECT_NEAR(coarse / fine, 16.0, 3.0);
}

TEST(FurutaPlant, LeansAndCarriesAsTheEquationsSay) {
  PlantOptions o = furuta(2.5e-4);
  o.effects = {{"tilt", "", {{"angle_rad", 0.3}}}, {"payload", "", {{"mass_kg", 0.02}}}};
  const tiller_body_t body = {9.81 * std::sin(0.3), -9.81 * std::cos(0.3), 0.02, 0.0};
  EXPECT_LT(apart(o, body, 100, 0.01), 5e-4);
  // and it would show: a level table, an empty pendulum
  EXPECT_GT(apart(o, {0.0, -9.81, 0.02, 0.0}, 100, 0.01), 0.1);
  EXPECT_GT(apart(o, {9.81 * std::sin(0.3), -9.81 * std::cos(0.3), 0.0, 0.0}, 100, 0.01), 0.1);
}

TEST(FurutaPlant, KeepsItsEnergy) {
  auto plant = make(furuta(5e-4));
  const double start = plant->energy_J();
  double worst = 0;
  for (int k = 0; k < 300; ++k) {
    plant->advance(0.01);
    worst = std::max(worst, std::fabs(plant->energy_J() - start));
  }
  EXPECT_LT(worst, 2e-5);  // of 0.03 J between hanging and standing
}

PlantOptions hopper(double step_s) {
  PlantOptions o;
  o.kind = "hopper";
  o.step_s = step_s;
  o.watchdog_timeout_s = 0;
  o.parameters = {{"leg_inertia_kgm2", 1e-7}};
  return o;
}

TEST(HopperPlant, FliesAsTheEquationsSay) {
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  const auto fly = [&](double step_s) {
    PlantOptions o = hopper(step_s);
    o.initial_state = {{"z_m", 3.0},   {"pitch_rad", 0.2},    {"hip_rad", -0.5},  {"leg_m", 0.45},  {"x_m_s", 1.0},
                       {"z_m_s", 1.0}, {"pitch_rad_s", -1.0}, {"hip_rad_s", 2.0}, {"leg_m_s", -0.5}};
    const tiller_model_t& m = *tiller_find_model("hopper");
    auto plant = make(o);
    const auto p = parameters_of(m, *plant);
    auto x = truth(*plant);
    double most = 0;
    for (int k = 0; k < 50; ++k) {
      const double u[] = {2.0 * std::sin(0.13 * k), 20.0 * std::cos(0.2 * k)};
      plant->apply(u);
      plant->advance(0.01);
      step_model(m, level, p.data(), u, 0.01, x);
      const auto y = truth(*plant);
      for (std::size_t i = 0; i < x.size(); ++i) most = std::max(most, std::fabs(x[i] - y[i]));
    }
    return most;
  };
  const double coarse = fly(1e-4), fine = fly(5e-5);
  EXPECT_LT(fine, 0.02);                 // of rates up to 6 rad/s
  EXPECT_NEAR(coarse / fine, 2.0, 0.3);  // plain steps are of first order
}

/// Largest distances of places and of the body's speeds on the way of a hopper dropped on its foot, leaning and moving
/// sideways: a landing, a stance of a quarter of a second, up again. The foot's own speed is left out: it lands.
void land(double true_friction, double& place, double& speed) {
  const tiller_body_t level = {0.0, -9.81, 0.0, 0.0};
  PlantOptions o = hopper(5e-5);
  o.initial_state = {{"z_m", 0.62}, {"hip_rad", 0.1}, {"leg_m", 0.5}, {"x_m_s", 0.5}};
  const tiller_model_t& m = *tiller_find_model("hopper");
  auto plant = make(o);
  const auto p = parameters_of(m, *plant);
  o.parameters["ground_friction"] = true_friction;
  plant = make(o);
  auto x = truth(*plant);
  place = speed = 0;
  for (int k = 0; k < 60; ++k) {
    const double u[] = {0.5 * std::sin(0.13 * k), 20.0 * std::cos(0.2 * k)};
    plant->apply(u);
    plant->advance(0.01);
    step_model(m, level, p.data(), u, 0.01, x);
    const auto y = truth(*plant);
    for (std::size_t i = 0; i < 5; ++i) place = std::max(place, std::fabs(x[i] - y[i]));
    for (std::size_t i = 5; i < 8; ++i) speed = std::max(speed, std::fabs(x[i] - y[i]));
  }
}

TEST(HopperPlant, LandsNearWhereTheEquationsLand) {
  double place, speed, other_place, other_speed;
  land(0.7, place, speed);
  std::printf("places within %.4f, the body's speeds within %.4f\n", place, speed);
  // the equations' foot brakes within a few milliseconds and millimetres, ODE's within a step
  EXPECT_LT(place, 0.01);
  EXPECT_LT(speed, 0.03);
  // ice would show
  land(0.02, other_place, other_speed);
  EXPECT_GT(other_place, 5 * place);
}

}  // namespace
}  // namespace tiller::sim
