// Hidden effects that no catalogue has.

#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

constexpr double kPi = 3.141592653589793;

PlantOptions axis(const std::string& kind, const std::map<std::string, double>& parameters) {
  PlantOptions o;
  o.kind = "linear_axis";
  o.watchdog_timeout_s = 0;
  o.effects = {{kind, "", parameters}};
  return o;
}

TEST(OtherSprings, KeepTheEnergyOfTheirPotentials) {
  PlantOptions o = axis("square_spring", {{"stiffness_SI2", 6.0}});
  o.initial_state["position_m"] = -0.5;
  auto plant = make(o);
  for (int k = 0; k < 30; ++k) {
    plant->advance(0.1);
    const auto x = truth(*plant);
    ASSERT_NEAR(0.5 * x[1] * x[1] + 2 * std::pow(std::fabs(x[0]), 3), 2 * 0.125, 1e-5);
  }
  o = axis("gap_spring", {{"stiffness_SI", 40.0}, {"gap_SI", 0.2}});
  o.initial_state = {{"velocity_m_s", 1.0}};
  plant = make(o);
  plant->advance(0.09);
  EXPECT_EQ(truth(*plant)[1], 1.0);  // still in the gap
  double furthest = 0;
  for (int k = 0; k < 1000; ++k) {
    plant->advance(0.001);
    furthest = std::max(furthest, truth(*plant)[0]);
  }
  EXPECT_NEAR(furthest, 0.1 + 1 / std::sqrt(40.0), 1e-4);
}

TEST(HardStop, PushesBackAndNeverPulls) {
  PlantOptions o = axis("hard_stop", {{"position_SI", 0.3}, {"stiffness_SI", 2000}, {"damping_SI", 10}});
  o.initial_state = {{"velocity_m_s", 1.0}};
  auto plant = make(o);
  double furthest = 0;
  for (int k = 0; k < 1000; ++k) {
    plant->advance(0.001);
    furthest = std::max(furthest, truth(*plant)[0]);
  }
  EXPECT_LT(furthest, 0.3 + 1 / std::sqrt(2000.0));
  EXPECT_GT(furthest, 0.3);
  const double back = truth(*plant)[1];
  EXPECT_LT(back, -0.3);
  EXPECT_GT(back, -1.0);
}

TEST(WindGusts, HaveTheirSizeMemoryAndSeed) {
  const double force = 0.7, correlation_s = 0.05;
  PlantOptions o = axis("wind_gusts", {{"force_SI", force}, {"correlation_s", correlation_s}});
  const auto pushes = [](const PlantOptions& options) {
    auto plant = make(options);
    std::vector<double> all;
    double last = 0;
    for (int k = 0; k < 40000; ++k) {
      plant->advance(0.001);
      all.push_back((truth(*plant)[1] - last) / 0.001);
      last = truth(*plant)[1];
    }
    return all;
  };
  const auto f = pushes(o);
  double square = 0, product = 0;
  for (std::size_t k = 50; k < f.size(); ++k) {
    square += f[k] * f[k];
    product += f[k] * f[k - 50];
  }
  // 40 s hold about 400 independent gusts: 5 % of the deviation, 7 % of the correlation; three times that
  EXPECT_NEAR(std::sqrt(square / 39950.0) / force, 1.0, 0.15);
  EXPECT_NEAR(product / square, std::exp(-1.0), 0.2);
  EXPECT_EQ(pushes(o), f);
  PlantOptions other = o, fine = o;
  other.seed = 2;
  EXPECT_NE(pushes(other)[1000], f[1000]);
  fine.step_s = 0.00025;
  EXPECT_NEAR(pushes(fine)[1000], f[1000], 1e-9);  // drawn by the millisecond, not by the step
}

TEST(PeriodicForce, SwingsWithTime) {
  const double force = 0.8, hz = 2;
  auto plant = make(axis("periodic_force", {{"force_SI", force}, {"frequency_Hz", hz}}));
  double least = 1e9, most = -1e9;
  for (int k = 0; k < 1000; ++k) {
    plant->advance(0.001);
    least = std::min(least, truth(*plant)[1]);
    most = std::max(most, truth(*plant)[1]);
  }
  EXPECT_NEAR(most - least, 2 * force / (2 * kPi * hz), 1e-4);
}

TEST(Shove, BeginsAndEnds) {
  auto plant = make(axis("shove", {{"force_SI", 0.8}, {"begin_s", 0.1}, {"for_s", 0.05}}));
  plant->advance(0.1);
  EXPECT_EQ(truth(*plant)[1], 0.0);
  plant->advance(0.05);
  EXPECT_NEAR(truth(*plant)[1], 0.8 * 0.05, 0.8 * 0.001) << "a kilogram; to a step";
  plant->advance(0.1);
  EXPECT_NEAR(truth(*plant)[1], 0.8 * 0.05, 1e-9);
}

TEST(FrictionDrift, FallsToAFifthAsItWarms) {
  PlantOptions o = axis("friction_drift", {{"friction_SI", 1.0}, {"heat_J", 0.5}});
  auto plant = make(o);
  command(*plant, 2.0);
  plant->advance(0.05);
  EXPECT_NEAR(truth(*plant)[1] / 0.05, 1.0, 0.02);  // cold: 2 N - 1 N
  plant->advance(5.0);
  const double before = truth(*plant)[1];
  plant->advance(1.0);
  EXPECT_NEAR(truth(*plant)[1] - before, 1.8, 0.01);
}

TEST(RoughPatches, HoldOnARoughPatchAlone) {
  PlantOptions o = axis("rough_patches", {{"friction_SI", 1.0}, {"spatial_period_SI", 0.1}});
  o.initial_state["position_m"] = 0.02;
  auto rough = make(o);
  command(*rough, 0.9);
  rough->advance(1.0);
  EXPECT_NEAR(truth(*rough)[0], 0.02, 1e-9);
  o.initial_state["position_m"] = 0.07;
  auto smooth = make(o);
  command(*smooth, 0.9);
  smooth->advance(0.1);
  EXPECT_NEAR(truth(*smooth)[1], 0.09, 1e-9);
}

TEST(LooseCoupling, SlipsItsShareOfTheTime) {
  auto plant = make(axis("loose_coupling", {{"share", 0.25}, {"slip_s", 0.02}}));
  command(*plant, 1.0);
  int slips = 0;
  for (int k = 0; k < 4000; ++k) {
    plant->advance(0.01);
    slips += motor(*plant) == 0.0;
  }
  // 2000 draws: three deviations of 0.97 %
  EXPECT_NEAR(slips / 4000.0, 0.25, 0.03);
}

TEST(GainDrift, FallsBySoMuchEachSecond) {
  auto plant = make(axis("gain_drift", {{"drift_1_s", -0.25}}));
  command(*plant, 2.0);
  plant->advance(2.0);
  EXPECT_NEAR(motor(*plant), 1.0, 1e-3);
  EXPECT_NEAR(truth(*plant)[1], 2.0 * 2.0 - 0.25 * 2.0 * 2.0 * 2.0 / 2, 1e-9);  // 1 kg: the impulse
  plant->advance(3.0);
  EXPECT_EQ(motor(*plant), 0.0);  // never a push the other way
}

TEST(SupplySag, SagsUnderLoadAndRecovers) {
  auto plant = make(axis("supply_sag", {{"droop_per_SI", 0.25}, {"recovery_s", 0.1}}));
  command(*plant, 2.0);
  plant->advance(0.0005);
  EXPECT_NEAR(motor(*plant), 2.0, 0.01);
  plant->advance(2.0);
  EXPECT_NEAR(motor(*plant), 2.0 / 1.5, 1e-6);
  command(*plant, 0.0);
  plant->advance(2.0);
  command(*plant, 2.0);
  plant->advance(0.0005);
  EXPECT_NEAR(motor(*plant), 2.0, 0.01);
}

TEST(CommandJitter, GivesWhatWasAskedUpToTheDelayAgo) {
  auto plant = make(axis("command_jitter", {{"delay_s", 0.05}}));
  double least_s = 1, most_s = 0;
  for (int k = 1; k <= 400; ++k) {
    command(*plant, k);  // the command is its own time stamp
    plant->advance(0.01);
    const double age_s = 0.01 * (k - motor(*plant));
    if (k < 10) continue;
    least_s = std::min(least_s, age_s);
    most_s = std::max(most_s, age_s);
  }
  EXPECT_GE(least_s, 0.0);
  EXPECT_LE(most_s, 0.051);
  EXPECT_GT(most_s - least_s, 0.02);
}

TEST(ElasticJoint, RotorAndJointSwingAgainstEachOther) {
  const double k = 90, rotor = 0.25;
  auto plant = make(axis("elastic_joint", {{"stiffness_SI", k}, {"rotor_inertia_SI", rotor}, {"damping_SI", 0}}));
  command(*plant, 1.0);
  // the joint's acceleration is (1 - cos w t) u / (m + J), w^2 = k (1/m + 1/J): nothing at first, u / 1.25 in the mean
  const double w = std::sqrt(k * (1 + 1 / rotor)), period = 2 * kPi / w;
  plant->advance(period / 2);
  EXPECT_NEAR(truth(*plant)[1], period / 2 / 1.25, 1e-3);
  auto again = make(axis("elastic_joint", {{"stiffness_SI", k}, {"rotor_inertia_SI", rotor}, {"damping_SI", 0}}));
  command(*again, 1.0);
  again->advance(0.01);
  EXPECT_LT(truth(*again)[1], 0.1 * 0.01 / 1.25);
}

TEST(SwingingLoad, AddsAPendulumAndKeepsEnergy) {
  for (const char* kind : {"pendulum", "cart_pole", "two_link_arm"}) {
    PlantOptions o;
    o.kind = kind;
    o.watchdog_timeout_s = 0;
    if (o.kind == "pendulum") o.initial_state["angle_rad"] = 1.0;
    if (o.kind == "two_link_arm") o.initial_state["shoulder_rad"] = 1.0;
    if (o.kind == "cart_pole") o.initial_state["angle_rad"] = 2.4;
    auto alone = make(o);
    o.effects = {{"swinging_load", "", {{"mass_kg", 0.1}, {"length_m", 0.2}}}};
    auto plant = make(o);
    const double start = plant->energy_J();
    for (int k = 0; k < 300; ++k) {
      plant->advance(0.01);
      ASSERT_NEAR(plant->energy_J(), start, 2e-3) << kind << " " << k;
    }
    alone->advance(3.0);
    EXPECT_GT(std::fabs(truth(*plant)[0] - truth(*alone)[0]), 1e-3) << kind;
  }
}

// A force F pushes a cart M from rest, with a load m on a string l. Both together go with F / (M + m), and about that
// the cart swings with w^2 = g/l (1 + m/M): x'' = F / (M + m) (1 + m/M cos wt). The string leans by 0.016 rad on the
// mean, so that its sine is its angle.
TEST(HungLoad, SwingsBelowTheCart) {
  PlantOptions o;
  o.kind = "cart_pole";
  o.watchdog_timeout_s = 0;
  o.parameters = {{"pole_mass_kg", 1e-6}};
  o.effects = {{"hung_load", "cart", {{"mass_kg", 0.25}, {"length_m", 0.2}}}};
  auto plant = make(o);
  command(*plant, 0.2);
  const double mean = 0.2 / 1.25, squared = 9.81 / 0.2 * 1.25;
  for (int k = 1; k <= 200; ++k) {
    plant->advance(0.01);
    const double t = 0.01 * k;
    const double swing = 0.25 / squared * (1 - std::cos(std::sqrt(squared) * t));
    // a hundredth of the swing, which is 0.65 mm
    ASSERT_NEAR(truth(*plant)[0], mean * (0.5 * t * t + swing), 1e-5) << k;
  }
}

TEST(EncoderEccentricity, ShowsAWaveOverTheTurn) {
  PlantOptions o = axis("encoder_eccentricity", {{"amplitude_SI", 0.01}, {"spatial_period_SI", 0.4}});
  o.initial_state["position_m"] = 0.1;
  double clean = 0;
  make(o)->measure_clean(&clean);
  EXPECT_NEAR(clean, 0.11, 1e-12);
}

// On top of the latency that all sensors have, and of nothing but this one: a cart-pole's cart on its way, and its
// pole.
TEST(SensorDelay, ShowsOneSensorOfBefore) {
  PlantOptions o;
  o.kind = "cart_pole";
  o.watchdog_timeout_s = 0;
  o.measurement_latency_s = 0.01;
  o.initial_state["position_m"] = 0.2;
  o.initial_state["velocity_m_s"] = 0.5;
  const auto plain = make(o);
  o.effects = {{"sensor_delay", "position_m", {{"delay_s", 0.034}}}};
  const auto late = make(o);
  double before[2], now[2], seen[2];
  plain->advance(0.1 - 0.034);
  plain->measure_clean(before);
  plain->advance(0.034);
  plain->measure_clean(now);
  late->advance(0.1);
  late->measure_clean(seen);
  EXPECT_NEAR(seen[0], before[0], 1e-9);
  EXPECT_EQ(seen[1], now[1]);
  EXPECT_GT(now[0] - before[0], 0.005);
}

}  // namespace
}  // namespace tiller::sim
