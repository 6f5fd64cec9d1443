// Every hidden effect of the catalogue's names does what its name says, against closed forms.

#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

constexpr double kPi = 3.141592653589793;
using Parameters = std::map<std::string, double>;

/// 1 kg on a rail.
PlantOptions axis(const std::string& kind = "", const std::string& port = "", const Parameters& parameters = {}) {
  PlantOptions o;
  o.kind = "linear_axis";
  o.watchdog_timeout_s = 0;
  if (!kind.empty()) o.effects = {{kind, port, parameters}};
  return o;
}

/// 0.5 kg at 0.5 m.
PlantOptions arm(const std::string& kind, const Parameters& parameters, double damping = 0) {
  PlantOptions o = pendulum();
  o.parameters["damping_Nms"] = damping;
  o.effects = {{kind, "", parameters}};
  return o;
}

std::vector<double> after(PlantOptions o, double force, double seconds, double velocity = 0, double position = 0) {
  o.initial_state = {{"velocity_m_s", velocity}, {"position_m", position}};
  auto plant = make(o);
  command(*plant, force);
  plant->advance(seconds);
  return truth(*plant);
}

TEST(StribeckFriction, BreaksAwayAtStictionAndSlidesAtLess) {
  const auto o =
      axis("stribeck_friction", "", {{"friction_SI", 1.0}, {"stiction_extra_SI", 0.5}, {"stribeck_velocity_SI", 0.05}});
  EXPECT_LT(std::fabs(after(o, 1.49, 3.0)[0]), 1e-9);
  // three deviations of the bell past 0.05 m/s only sliding friction is left: 0.6 m/s^2
  EXPECT_NEAR(after(o, 1.6, 3.0)[1] - after(o, 1.6, 2.0)[1], 0.6, 1e-6);
  // a slow motion is braked by 1.5 N and stops after 0.02 / 1.5 s
  EXPECT_LT(std::fabs(after(o, 0, 0.02 / 1.4, 0.02)[1]), 1e-9);
}

TEST(AsymmetricFriction, HoldsAndBrakesByDirection) {
  const auto o = axis("asymmetric_friction", "", {{"forward_SI", 2.0}, {"backward_SI", 1.0}});
  EXPECT_NEAR(after(o, 0, 1.0, 3.0)[1], 1.0, 1e-9);
  EXPECT_NEAR(after(o, 0, 1.0, -3.0)[1], -2.0, 1e-9);
  EXPECT_LT(std::fabs(after(o, 1.99, 2.0)[0]), 1e-9);
  EXPECT_LT(std::fabs(after(o, -0.99, 2.0)[0]), 1e-9);
  EXPECT_GT(after(o, 2.01, 2.0)[0], 0.01);
  EXPECT_LT(after(o, -1.01, 2.0)[0], -0.01);
}

TEST(LoadFriction, GoesWithTheDriveAlone) {
  const auto o = axis("load_friction", "", {{"coefficient", 0.2}});
  EXPECT_NEAR(after(o, 3.0, 1.0)[1], 3.0 - 0.6, 1e-9);
  EXPECT_NEAR(after(o, -3.0, 1.0, 10.0)[1], 10.0 - 3.0 - 0.6, 1e-9);
  EXPECT_NEAR(after(o, 0.0, 1.0, 1.0)[1], 1.0, 1e-12);
}

TEST(PositionFriction, TakesTheWorkOfItsLevelAlongTheWay) {
  const double friction = 0.4, sine = 0.3, pitch = 0.2;
  const auto x =
      after(axis("position_friction", "",
                 {{"friction_SI", friction}, {"cosine_SI", 0}, {"sine_SI", sine}, {"spatial_period_SI", pitch}}),
            0, 0.5, 1.0);
  const double wave = 2 * 3.141592653589793 / pitch;
  const double work = friction * x[0] + sine / wave * (1 - std::cos(wave * x[0]));
  EXPECT_NEAR(0.5 * (1.0 - x[1] * x[1]), work, 1e-3);
}

TEST(QuadraticDrag, SlowsDownAsAHyperbola) {
  // v' = -c v^2: v0 / (1 + c v0 t); 1e-4: second order at 0.5 ms
  EXPECT_NEAR(after(axis("quadratic_drag", "", {{"drag_SI", 0.5}}), 0, 2.0, 3.0)[1], 3.0 / (1 + 0.5 * 3.0 * 2.0), 1e-4);
}

TEST(LugreFriction, IsASpringBeforeItSlides) {
  const auto o = axis(
      "lugre_friction", "",
      {{"friction_SI", 1.0}, {"stiction_extra_SI", 0}, {"stribeck_velocity_SI", 0.1}, {"bristle_stiffness_SI", 400.0}});
  // 0.05 N against 400 N/m: an oscillation of 20 rad/s about 0.125 mm, whose highest point stands at half a period. The
  // bristles give way by up to a twentieth there, as 1 - deflection / longest says.
  const double top = after(o, 0.05, kPi / 20)[0];
  EXPECT_NEAR(top, 2 * 0.05 / 400, 0.15 * 2 * 0.05 / 400);
  EXPECT_LT(std::fabs(after(o, 0.05, 2 * kPi / 20)[0]), 0.2 * top);  // springs back, where dry friction would hold it
  // sliding: level friction
  EXPECT_NEAR(after(o, 3.0, 2.0)[1] - after(o, 3.0, 1.0)[1], 2.0, 1e-3);
}

TEST(Springs, SwingAsTheyMust) {
  const double k = 25;
  // a period of 2 pi / 5 s
  const auto x = after(axis("linear_spring", "", {{"stiffness_SI", k}}), 0, 2 * kPi / 5, 0, 0.3);
  EXPECT_NEAR(x[0], 0.3, 1e-4);
  EXPECT_NEAR(x[1], 0.0, 2e-3);  // the period in whole steps, at 7.5 m/s^2
  const auto y = after(axis("cubic_spring", "", {{"stiffness_SI3", k}}), 0, 1.7, 0, 0.8);
  EXPECT_NEAR(0.5 * y[1] * y[1] + 0.25 * k * std::pow(y[0], 4), 0.25 * k * std::pow(0.8, 4), 1e-4);
  EXPECT_GT(std::fabs(y[0] - 0.8), 0.1);
}

TEST(Cogging, IsAPotentialOfItsPitch) {
  const double c = 0.3, s = -0.2, pitch = 0.15;
  const auto potential = [&](double q) {
    const double a = 2 * kPi * q / pitch;
    return -pitch / (2 * kPi) * (c * std::sin(a) - s * std::cos(a));
  };
  const auto o = axis("cogging", "", {{"cosine_SI", c}, {"sine_SI", s}, {"spatial_period_SI", pitch}});
  for (const double t : {0.1, 0.33, 1.0}) {
    const auto x = after(o, 0, t, 0.5);
    // of 0.014 J of potential
    EXPECT_NEAR(0.5 * x[1] * x[1] + potential(x[0]), 0.5 * 0.25 + potential(0), 1e-5) << t;
  }
}

TEST(TorqueRipple, DoesTheWorkOfTheDriveTimesItsHarmonics) {
  const double c = 0.2, s = -0.1, c2 = 0.05, s2 = 0.1, pitch = 0.2, u = 2.0, w = 2 * kPi / pitch;
  const auto x = after(axis("torque_ripple", "",
                            {{"cosine", c}, {"sine", s}, {"cosine2", c2}, {"sine2", s2}, {"spatial_period_SI", pitch}}),
                       u, 0.5);
  const double q = x[0];
  const double path = q + (c * std::sin(w * q) - s * (std::cos(w * q) - 1)) / w +
                      (c2 * std::sin(2 * w * q) - s2 * (std::cos(2 * w * q) - 1)) / (2 * w);
  EXPECT_NEAR(0.5 * x[1] * x[1], u * path, 1e-4);
  EXPECT_NE(q, after(axis(), u, 0.5)[0]);
}

TEST(JointInertia, ResistsAccelerationAndWeighsNothing) {
  EXPECT_NEAR(after(axis("joint_inertia", "", {{"inertia_SI", 0.6}}), 3.2, 1.0)[1], 2.0, 1e-9);
  // small swings of sqrt(m g l / (m l^2 + J))
  PlantOptions o = arm("joint_inertia", {{"inertia_SI", 0.075}});
  o.initial_state["angle_rad"] = 0.01;
  auto plant = make(o);
  const double period = 2 * kPi / std::sqrt(0.5 * 9.81 * 0.5 / (0.5 * 0.25 + 0.075));
  plant->advance(period);
  EXPECT_NEAR(truth(*plant)[0], 0.01, 1e-6);
  EXPECT_NEAR(truth(*plant)[1], 0.0, 2e-4);  // the period in whole microseconds, the step in half milliseconds
}

TEST(Tilt, MovesWhereThingsHangAndWhatRolls) {
  auto plant = make(arm("tilt", {{"angle_rad", 0.2}}, 0.2));
  plant->advance(20.0);
  EXPECT_NEAR(truth(*plant)[0], 0.2, 1e-6);
  EXPECT_NEAR(after(axis("tilt", "", {{"angle_rad", 0.2}}), 0, 1.0)[1], 9.81 * std::sin(0.2), 1e-9);
}

TEST(Payload, WeighsAndResists) {
  auto plant = make(arm("payload", {{"mass_kg", 0.25}}, 0.2));
  command(*plant, 1.0);
  plant->advance(30.0);
  EXPECT_NEAR(truth(*plant)[0], std::asin(1.0 / (0.75 * 9.81 * 0.5)), 1e-5);
  EXPECT_NEAR(after(axis("payload", "", {{"mass_kg", 0.6}}), 3.2, 1.0)[1], 2.0, 1e-9);
}

TEST(Drive, CurvesOfTheMotor) {
  const auto force = [](const std::string& kind, const Parameters& parameters, double wanted) {
    auto plant = make(axis(kind, "force_N", parameters));
    command(*plant, wanted);
    plant->advance(0.0005);
    return motor(*plant);
  };
  EXPECT_EQ(force("dead_zone", {{"width_SI", 0.5}}, 0.4), 0.0);
  EXPECT_EQ(force("dead_zone", {{"width_SI", 0.5}}, 2.0), 1.5);
  EXPECT_EQ(force("dead_zone", {{"width_SI", 0.5}}, -2.0), -1.5);
  EXPECT_EQ(force("saturation", {{"limit_SI", 1.5}}, 2.0), 1.5);
  EXPECT_EQ(force("saturation", {{"limit_SI", 1.5}}, -2.0), -1.5);
  EXPECT_EQ(force("saturation", {{"limit_SI", 0}}, 2.0), 2.0);
  EXPECT_EQ(force("actuator_gain", {{"gain_error", -0.25}}, 2.0), 1.5);
  // 0.5 ms at 1000 N/s: from 0 to 0.5 N, 0.25 in the mean
  EXPECT_NEAR(force("rate_limit", {{"rate_SI_s", 1000}}, 2.0), 0.25, 1e-12);
  // there after 0.1 ms: 0.1 N in the mean of that, 0.2 N for the rest
  EXPECT_NEAR(force("rate_limit", {{"rate_SI_s", 2000}}, 0.2), 0.2 * (0.1 * 0.5 + 0.4) / 0.5, 1e-12);
}

TEST(RateLimit, ClimbsAlongALine) {
  auto plant = make(axis("rate_limit", "", {{"rate_SI_s", 10}}));
  command(*plant, 2.0);
  plant->advance(0.1);
  EXPECT_NEAR(motor(*plant), 1.0, 3e-3);  // the mean of the last step
  plant->advance(0.2);
  EXPECT_EQ(motor(*plant), 2.0);
}

TEST(Backlash, ThePlayIsCrossedBeforeTheJointFeelsAnything) {
  const double gap = 0.04, rotor = 0.1, u = 1.0;
  const auto o = axis("backlash", "", {{"gap_SI", gap}, {"rotor_inertia_SI", rotor}});
  const double free_s = std::sqrt(2 * (gap / 2) * rotor / u);  // half the gap
  EXPECT_EQ(after(o, u, free_s - 0.002)[1], 0.0);
  EXPECT_GT(after(o, u, free_s + 0.002)[1], 0.0);
  // pushed, both move as one: all momentum is in 1.1 kg
  EXPECT_NEAR(after(o, u, 2.0)[1], u * 2.0 / 1.1, 5e-3);
  // at a reversal the joint coasts until the rotor has crossed the whole gap
  PlantOptions p = o;
  auto plant = make(p);
  command(*plant, u);
  plant->advance(2.0);
  const double before = truth(*plant)[1];
  command(*plant, -u);
  const double cross_s = std::sqrt(2 * gap * rotor / u);
  plant->advance(0.9 * cross_s);
  EXPECT_NEAR(truth(*plant)[1], before, 2e-3);
  plant->advance(0.4);
  EXPECT_LT(truth(*plant)[1], before - 0.2);
}

TEST(Backlash, OnAHingeToo) {
  PlantOptions o = arm("backlash", {{"gap_SI", 0.1}, {"rotor_inertia_SI", 0.01}});
  o.parameters["gravity_m_s2"] = 0;
  auto plant = make(o);
  command(*plant, 0.1);
  plant->advance(0.09);  // half of 0.1 rad at 10 rad/s^2 takes 0.1 s
  EXPECT_EQ(truth(*plant)[1], 0.0);
  plant->advance(0.91);
  EXPECT_NEAR(truth(*plant)[1], 0.1 / (0.125 + 0.01), 0.02);
}

TEST(Sensors, ShowWhatTheyWereTold) {
  for (const auto& [kind, name, shown] :
       {std::tuple("sensor_bias", "bias_SI", 0.3 + 0.1), std::tuple("sensor_scale", "scale_error", 0.3 * 1.1)}) {
    PlantOptions o = axis(kind, "position_m", {{name, 0.1}});
    o.initial_state["position_m"] = 0.3;
    auto plant = make(o);
    double clean = 0;
    plant->measure_clean(&clean);
    EXPECT_NEAR(clean, shown, 1e-15) << kind;
    EXPECT_EQ(reading(*plant)[0], clean);
    EXPECT_EQ(truth(*plant)[0], 0.3);
  }
}

TEST(HiddenEffects, AtZeroParametersChangeNothing) {
  PlantOptions plain = cart_pole();
  PlantOptions zero = plain;
  for (const auto& [kind, parameters] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"stribeck_friction", {"friction_SI", "stiction_extra_SI", "stribeck_velocity_SI"}},
           {"asymmetric_friction", {"forward_SI", "backward_SI"}},
           {"load_friction", {"coefficient"}},
           {"quadratic_drag", {"drag_SI"}},
           {"lugre_friction", {"friction_SI", "stiction_extra_SI", "stribeck_velocity_SI", "bristle_stiffness_SI"}},
           {"linear_spring", {"stiffness_SI"}},
           {"cubic_spring", {"stiffness_SI3"}},
           {"cogging", {"cosine_SI", "sine_SI", "spatial_period_SI"}},
           {"torque_ripple", {"cosine", "sine", "cosine2", "sine2", "spatial_period_SI"}},
           {"joint_inertia", {"inertia_SI"}},
           {"tilt", {"angle_rad"}},
           {"payload", {"mass_kg"}},
           {"dead_zone", {"width_SI"}},
           {"saturation", {"limit_SI"}},
           {"actuator_gain", {"gain_error"}},
           {"rate_limit", {"rate_SI_s"}},
           {"backlash", {"gap_SI", "rotor_inertia_SI"}},
           {"sensor_bias", {"bias_SI"}},
           {"sensor_scale", {"scale_error"}},
           {"square_spring", {"stiffness_SI2"}},
           {"hard_stop", {"position_SI", "stiffness_SI", "damping_SI"}},
           {"position_friction", {"friction_SI", "cosine_SI", "sine_SI", "spatial_period_SI"}},
           {"supply_sag", {"droop_per_SI", "recovery_s"}},
           {"gain_drift", {"drift_1_s"}},
           {"elastic_joint", {"stiffness_SI", "rotor_inertia_SI", "damping_SI"}}}) {
    HiddenEffect effect{kind, "", {}};
    for (const std::string& name : parameters) effect.parameters[name] = 0;
    zero.effects.push_back(effect);
  }
  auto a = make(plain), b = make(zero);
  for (int i = 0; i < 200; ++i) {
    const double u = 5 * std::sin(0.1 * i);
    command(*a, u);
    command(*b, u);
    a->advance(0.01);
    b->advance(0.01);
  }
  EXPECT_EQ(truth(*a), truth(*b));
  EXPECT_EQ(reading(*a), reading(*b));
}

TEST(HiddenEffects, BodiesThatHaveNoPlaceAreRefused) {
  PlantOptions o = cart_pole();
  o.effects = {{"joint_inertia", "pole", {{"inertia_SI", 0.1}}}};
  std::string error;
  EXPECT_EQ(Plant::make(o, error), nullptr);
  EXPECT_NE(error.find("joint_inertia"), std::string::npos) << error;
  o.kind = "two_link_arm";
  o.effects = {{"backlash", "elbow_Nm", {{"gap_SI", 0.1}, {"rotor_inertia_SI", 0.1}}}};
  EXPECT_EQ(Plant::make(o, error), nullptr);
  EXPECT_NE(error.find("backlash"), std::string::npos) << error;
}

TEST(TwoLinkArm, ItsMotorsAreTheAcrobotsAndOneMore) {
  PlantOptions o;
  o.kind = "acrobot";
  o.watchdog_timeout_s = 0;
  o.initial_state = {{"shoulder_rad", 0.4}, {"elbow_rad", -0.9}};
  PlantOptions both = o;
  both.kind = "two_link_arm";
  auto acrobot = make(o), arm = make(both);
  command(*acrobot, 0.7);
  const double torques[2] = {0.0, 0.7};
  arm->apply(torques);
  acrobot->advance(0.5);
  arm->advance(0.5);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(truth(*arm)[i], truth(*acrobot)[i], 1e-9) << i;
  const double shoulder[2] = {1.0, 0.0};
  auto pushed = make(both);
  pushed->apply(shoulder);
  auto left = make(both);
  pushed->advance(0.01);
  left->advance(0.01);
  EXPECT_GT(truth(*pushed)[2] - truth(*left)[2], 0.01);
}

}  // namespace
}  // namespace tiller::sim
