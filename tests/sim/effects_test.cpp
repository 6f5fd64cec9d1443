#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

TEST(ActuatorLag, StepResponse) {
  const double tau = 0.05, force = 3.0;
  PlantOptions o = cart_pole();
  o.effects = {{"actuator_lag", "", {{"time_constant_s", tau}}}};
  auto plant = make(o);
  command(*plant, force);
  const double h = o.step_s;
  for (int i = 1; i <= 400; ++i) {
    plant->advance(h);
    // motor() is the mean over the step that ended now: the integral of 1 - exp(-t / tau) over it, exactly
    const double end = i * h, start = end - h;
    const double mean = 1 - tau / h * (std::exp(-start / tau) - std::exp(-end / tau));
    ASSERT_NEAR(motor(*plant), force * mean, 1e-11) << i;
  }
  EXPECT_NEAR(motor(*plant), force * (1 - std::exp(-4.0)), 1e-3 * force);
}

TEST(ActuatorLag, ImpulseIsExactAtAnyStep) {
  // a rod of 1e-6 kg leaves a cart alone: v = F / M (t - tau (1 - exp(-t / tau)))
  const double tau = 0.02, t = 0.1;
  for (const double h : {0.001, 0.0005, 0.0001}) {
    PlantOptions o = cart_pole();
    o.step_s = h;
    o.parameters["pole_mass_kg"] = 1e-6;
    o.effects = {{"actuator_lag", "force_N", {{"time_constant_s", tau}}}};
    auto plant = make(o);
    command(*plant, 1.0);
    plant->advance(t);
    EXPECT_NEAR(truth(*plant)[2], t - tau * (1 - std::exp(-t / tau)), 1e-6) << h;  // the rod's 1e-6
  }
}

TEST(InputDelay, IsExactToTheStep) {
  PlantOptions o = cart_pole();
  o.effects = {{"input_delay", "", {{"delay_s", 0.035}}}};
  auto plant = make(o);
  plant->advance(0.010);
  command(*plant, 2.0);
  while (plant->time_us() < 45'000) {
    plant->advance(o.step_s);
    ASSERT_EQ(motor(*plant), 0.0) << plant->time_us();
    ASSERT_LT(std::fabs(truth(*plant)[2]), 1e-15) << plant->time_us();  // sin(pi) is 1e-16, not zero
  }
  plant->advance(o.step_s);
  EXPECT_EQ(motor(*plant), 2.0);
}

TEST(InputDelay, ShiftsAWholeCommandSequence) {
  PlantOptions o = cart_pole(), late = o;
  late.effects = {{"input_delay", "", {{"delay_s", 0.02}}}};
  auto direct = make(o), delayed = make(late);
  std::vector<double> a, b;
  for (int i = 0; i < 100; ++i) {
    command(*direct, std::sin(i * 0.7));
    command(*delayed, std::sin(i * 0.7));
    direct->advance(0.005);
    delayed->advance(0.005);
    a.push_back(motor(*direct));
    b.push_back(motor(*delayed));
  }
  for (std::size_t i = 4; i < a.size(); ++i) ASSERT_EQ(b[i], a[i - 4]) << i;  // 20 ms are four ticks
}

TEST(CommandLatency, ActsLikeADelayOfTheLine) {
  PlantOptions o = cart_pole(), hidden = o;
  o.command_latency_s = 0.015;
  hidden.effects = {{"input_delay", "", {{"delay_s", 0.015}}}};
  auto a = make(o), b = make(hidden);
  for (int i = 0; i < 50; ++i) {
    command(*a, 0.1 * i);
    command(*b, 0.1 * i);
    a->advance(0.01);
    b->advance(0.01);
    ASSERT_EQ(truth(*a), truth(*b)) << i;
  }
  EXPECT_GT(truth(*a)[0], 0);
}

TEST(ConstantOffset, PushesWithoutACommand) {
  PlantOptions o = cart_pole();
  o.effects = {{"constant_offset", "cart", {{"force_SI", -1.1}}}};
  auto plant = make(o);
  plant->advance(1.0);
  const auto x = truth(*plant);
  // the impulse, whatever the rod does (tolerance: motion_test.cpp, momentum)
  EXPECT_NEAR(1.1 * x[2] + 0.1 * 0.5 * std::cos(x[1]) * x[3], -1.1, 1.3e-3);
}

TEST(ConstantOffset, BalancesThePendulumWhereItMust) {
  PlantOptions o = pendulum();
  o.parameters["damping_Nms"] = 0.2;
  o.effects = {{"constant_offset", "joint", {{"force_SI", 1.0}}}};
  auto plant = make(o);
  plant->advance(20.0);
  // m g l sin a = 1; twenty seconds are over a hundred time constants, so a millionth covers the rest
  EXPECT_NEAR(truth(*plant)[0], std::asin(1.0 / (0.5 * 9.81 * 0.5)), 1e-6);
}

TEST(Effects, AtZeroParametersChangeNothing) {
  PlantOptions plain = cart_pole(), zero = plain;
  zero.effects = {{"viscous_friction", "cart", {{"damping_SI", 0}}},  {"viscous_friction", "pole", {{"damping_SI", 0}}},
                  {"coulomb_friction", "cart", {{"friction_SI", 0}}}, {"constant_offset", "cart", {{"force_SI", 0}}},
                  {"actuator_lag", "", {{"time_constant_s", 0}}},     {"input_delay", "", {{"delay_s", 0}}}};
  auto a = make(plain), b = make(zero);
  for (int i = 0; i < 200; ++i) {
    const double u = 5 * std::sin(0.1 * i);
    command(*a, u);
    command(*b, u);
    a->advance(0.01);
    b->advance(0.01);
  }
  EXPECT_EQ(truth(*a), truth(*b));  // to the last bit
}

TEST(Effects, OfTheMotorActInTheOrderGiven) {
  PlantOptions o = cart_pole();
  o.effects = {{"input_delay", "", {{"delay_s", 0.01}}}, {"actuator_lag", "", {{"time_constant_s", 0.02}}}};
  PlantOptions swapped = o;
  std::swap(swapped.effects[0], swapped.effects[1]);
  auto a = make(o), b = make(swapped);
  command(*a, 1.0);
  command(*b, 1.0);
  a->advance(0.05);
  b->advance(0.05);
  // both are linear and time-invariant: the order cannot matter for the motor's force
  EXPECT_NEAR(motor(*a), motor(*b), 1e-12);
  EXPECT_GT(motor(*a), 0.8);
}

}  // namespace
}  // namespace tiller::sim
