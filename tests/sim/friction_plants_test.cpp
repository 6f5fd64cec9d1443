#include <cmath>
#include <functional>

#include "plants.hpp"

// Plants that friction with the ground moves: a base whose wheels slip in every turn, and a box that a finger pushes.
// They are held against laws of slow motion that know no contacts, steps or bodies.

namespace tiller::sim {
namespace {

PlantOptions of_kind(const char* kind) {
  PlantOptions o;
  o.kind = kind;
  o.watchdog_timeout_s = 0;
  return o;
}

void go(Plant& plant, double first, double second) {
  const double both[] = {first, second};
  plant.apply(both);
}

/// Where a unimodal function is least.
double least(const std::function<double(double)>& f, double low, double high) {
  const double golden = 0.6180339887498949;
  for (int i = 0; i < 80; ++i) {
    const double a = high - golden * (high - low), b = low + golden * (high - low);
    (f(a) < f(b) ? high : low) = f(a) < f(b) ? b : a;
  }
  return 0.5 * (low + high);
}

/// How a base turns whose wheels' speeds differ by `difference_m_s`, by the principle of least dissipation (Coulomb's
/// friction is associated): of all motions the one at which the wheels' loads times their slips are least together. The
/// loads are those of a base at rest.
struct Turn {
  double rate_rad_s, icr_m;
};
Turn least_dissipation(double track, double wheelbase, double com, double difference_m_s) {
  const double front = 0.5 + com / wheelbase, rear = 0.5 - com / wheelbase;
  const auto power = [&](double rate, double icr) {
    const double ahead = 0.5 * difference_m_s - 0.5 * rate * track;
    return front * std::hypot(ahead, rate * (0.5 * wheelbase - icr)) +
           rear * std::hypot(ahead, rate * (0.5 * wheelbase + icr));
  };
  const auto best_icr = [&](double rate) {
    return least([&](double icr) { return power(rate, icr); }, -wheelbase, wheelbase);
  };
  const double rate = least([&](double r) { return power(r, best_icr(r)); }, 0.0, difference_m_s / track);
  return {rate, best_icr(rate)};
}

TEST(SkidSteer, RollsAsFarAsItsWheelsTurn) {
  auto plant = make(of_kind("skid_steer"));
  go(*plant, 3.0, 3.0);
  plant->advance(1.0);  // to get going
  const double start = truth(*plant)[0];
  plant->advance(2.0);
  const auto x = truth(*plant);
  EXPECT_NEAR(x[0] - start, 2.0 * 3.0 * 0.1, 1e-6);
  EXPECT_NEAR(x[1], 0, 1e-9);
  EXPECT_NEAR(x[2], 0, 1e-9);
  EXPECT_NEAR(x[3], 0.3, 1e-6);
}

// Where the centre of mass is in the middle, the law has a closed form: the track that it turns with is
// (track^2 + wheelbase^2) / track, whatever the friction is.
TEST(SkidSteer, TurnsWithAWiderTrackThanItsOwn) {
  for (const double friction : {0.3, 0.9})
    for (const double wheelbase : {0.2, 0.3}) {
      PlantOptions o = of_kind("skid_steer");
      o.parameters = {{"friction", friction}, {"wheelbase_m", wheelbase}};
      auto plant = make(o);
      go(*plant, -2.0, 2.0);
      plant->advance(1.0);
      const double start = truth(*plant)[2];
      plant->advance(1.0);
      const double effective = 0.1 * 4.0 / (truth(*plant)[2] - start);
      EXPECT_NEAR(effective, (0.16 + wheelbase * wheelbase) / 0.4, 1e-3 * effective) << friction;
    }
}

// Slow enough that what the base's own mass asks for in a curve is nothing: 0.15 m/s and 0.2 rad/s are 0.5 % of the
// friction.
TEST(SkidSteer, TurnsByLeastDissipation) {
  for (const double com : {-0.02, 0.01, 0.02}) {
    PlantOptions o = of_kind("skid_steer");
    o.parameters = {{"com_offset_m", com}};
    const Turn law = least_dissipation(0.4, 0.3, com, 0.1);
    for (const double speed : {-1.5, 0.0, 1.5}) {
      auto plant = make(o);
      go(*plant, speed - 0.5, speed + 0.5);
      plant->advance(2.0);
      const auto x = truth(*plant);
      const double aside = -std::sin(x[2]) * x[3] + std::cos(x[2]) * x[4];
      EXPECT_NEAR(x[5], law.rate_rad_s, 0.01 * law.rate_rad_s) << com << " " << speed;
      EXPECT_NEAR(-aside / x[5], law.icr_m, 0.005) << com << " " << speed;
    }
  }
}

TEST(SkidSteer, StandsOnASpotUntilItsMotorsTurn) {
  PlantOptions o = of_kind("skid_steer");
  o.initial_state = {{"x_m", 1.0}, {"y_m", -2.0}, {"heading_rad", 20.0}};
  auto plant = make(o);
  plant->advance(5.0);
  const auto x = truth(*plant);
  EXPECT_NEAR(x[0], 1.0, 1e-6);
  EXPECT_NEAR(x[1], -2.0, 1e-6);
  EXPECT_NEAR(x[2], 20.0, 1e-6) << "turns are counted";
}

TEST(SkidSteer, AWeakMotorSlowsDown) {
  PlantOptions o = of_kind("skid_steer");
  o.parameters = {{"torque_limit_Nm", 0.5}};  // a tenth of what slips the wheels
  auto plant = make(o);
  go(*plant, -2.0, 2.0);
  plant->advance(2.0);
  EXPECT_LT(std::fabs(truth(*plant)[5]), 0.01);
}

TEST(SkidSteer, NeitherJointsNorProcessNoise) {
  std::string error;
  PlantOptions o = of_kind("skid_steer");
  o.process_noise_sd = 0.1;
  EXPECT_EQ(Plant::make(o, error), nullptr);
  EXPECT_NE(error.find("skid_steer has none"), std::string::npos) << error;
  o.process_noise_sd = 0;
  for (const char* port : {"", "left"}) {
    o.effects = {{"viscous_friction", port, {{"damping_SI", 0.1}}}};
    EXPECT_EQ(Plant::make(o, error), nullptr);
    EXPECT_NE(error.find("viscous_friction acts at a joint"), std::string::npos) << error;
  }
  o.effects = {{"actuator_lag", "right_rad_s", {{"time_constant_s", 0.2}}}};
  auto plant = make(o);
  go(*plant, 2.0, 2.0);
  plant->advance(0.1);
  EXPECT_GT(0, truth(*plant)[5]) << "the right side comes late, so it turns to the right";
  EXPECT_EQ(make(of_kind("pusher_slider"))->states().size(), 8u);
}

PlantOptions push_at(double y_m) {
  PlantOptions o = of_kind("pusher_slider");
  o.initial_state = {{"pusher_x_m", -0.0601}, {"pusher_y_m", y_m}};
  return o;
}

TEST(PusherSlider, ABoxPushedInTheMiddleGoesStraightAndStops) {
  auto plant = make(push_at(0.0));
  go(*plant, 0.03, 0.0);
  plant->advance(3.0);
  auto x = truth(*plant);
  EXPECT_NEAR(x[3], -0.0601 + 0.09, 1e-9);
  EXPECT_NEAR(x[0], x[3] + 0.06, 2e-4);  // the finger gives by hundredths of a millimetre
  EXPECT_NEAR(x[1], 0, 1e-6);
  EXPECT_NEAR(x[2], 0, 1e-5);
  go(*plant, -0.05, 0.0);
  plant->advance(1.0);
  EXPECT_NEAR(truth(*plant)[0], x[0], 2e-4) << "friction stops it: v^2 / 2 mu g is a tenth of a millimetre";
}

/// How fast a box turns whose point (x, y) is moved along x, by the principle of least dissipation: sixteen feet bear
/// the same, and of all turns about that point the one with the least slip in sum.
double turn_of(double x, double y, double speed, double limit_length) {
  std::vector<std::pair<double, double>> feet;
  double mean = 0;
  for (const double a : {-0.75, -0.25, 0.25, 0.75})
    for (const double b : {-0.75, -0.25, 0.25, 0.75}) {
      feet.push_back({a, b});
      mean += std::hypot(a, b) / 16;
    }
  return least(
      [&](double rate) {
        double slip = 0;
        for (const auto& [a, b] : feet)
          slip += std::hypot(speed - rate * (b * limit_length / mean - y), rate * (a * limit_length / mean - x));
        return slip;
      },
      -2.0, 2.0);
}

// A finger that does not slide takes the point along that it touches. Against that law the plant has the weight's shift
// towards the finger: a few percent.
TEST(PusherSlider, ABoxPushedAsideTurnsByLeastDissipation) {
  for (const double c : {0.03, 0.04, 0.05})
    for (const double y : {-0.02, 0.01, 0.03}) {
      PlantOptions o = push_at(y);
      o.parameters = {{"limit_length_m", c}, {"friction", 2.0}};
      auto plant = make(o);
      go(*plant, 0.02, 0.0);
      plant->advance(0.2);
      // about the start: the box has turned a little by then
      const double law = turn_of(-0.05, y, 0.02, c);
      EXPECT_NEAR(truth(*plant)[7], law, 0.05 * std::fabs(law)) << c << " " << y;
      // the model's ellipsoid, u y / (c^2 + x^2 + y^2): sixteen feet turn more easily
      const double ellipsoid = -0.02 * y / (c * c + 0.0025 + y * y);
      EXPECT_NEAR(truth(*plant)[7], ellipsoid, 0.3 * std::fabs(ellipsoid)) << c << " " << y;
    }
}

// Beyond the cone the finger slides along the face: with no friction it leaves the box as it is.
TEST(PusherSlider, AFingerSlidesBeyondItsFriction) {
  PlantOptions o = push_at(0.0);
  o.initial_state["pusher_x_m"] = -0.05995;  // touches by 0.05 mm
  o.parameters = {{"friction", 0.0}};
  auto smooth = make(o);
  go(*smooth, 0.0, 0.02);
  smooth->advance(1.0);
  EXPECT_LT(std::fabs(truth(*smooth)[2]), 0.02);
  o.parameters = {{"friction", 0.5}};
  auto rough = make(o);
  go(*rough, 0.01, 0.02);
  rough->advance(1.0);
  EXPECT_LT(0.05, std::fabs(truth(*rough)[2]));
}

TEST(PusherSlider, PushesAtEveryFace) {
  for (int face = 0; face < 4; ++face) {
    const double angle = 1.5707963267948966 * face, c = std::cos(angle), s = std::sin(angle);
    PlantOptions o = of_kind("pusher_slider");
    o.initial_state = {{"pusher_x_m", 0.0601 * c}, {"pusher_y_m", 0.0601 * s}};
    auto plant = make(o);
    go(*plant, -0.03 * c, -0.03 * s);
    plant->advance(1.0);
    const auto x = truth(*plant);
    EXPECT_NEAR(-x[0] * c - x[1] * s, 0.03, 3e-4) << face;
    EXPECT_NEAR(x[0] * s - x[1] * c, 0, 1e-4) << face;
  }
}

TEST(FrictionPlants, RepeatThemselves) {
  for (const char* kind : {"skid_steer", "pusher_slider"}) {
    auto plant = make(of_kind(kind));
    const auto run = [&] {
      go(*plant, 0.03, 0.02);
      plant->advance(2.0);
      return truth(*plant);
    };
    const auto first = run();
    plant->reset();
    EXPECT_EQ(run(), first) << kind;
  }
}

}  // namespace
}  // namespace tiller::sim
