// Sensors that the logs have beside the robot's own: what they read of a path, and what they add to a fit.
#include "tools/gap/fit/gauges.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "effects/effect_info.hpp"
#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/base/frame_names.hpp"
#include "tools/gap/pipeline/gap.hpp"

namespace tiller::tools::gap {
namespace {

GridSensor sensor(const char* of, int derivative) { return {{"column", of, derivative, 0.01}, {}}; }

// An arm whose joints move as sines. Derivatives against finite differences of the forward kinematics in time.
TEST(Gauges, ReadWhatTheModelTellsAndItsDerivatives) {
  tiller::Config config;
  const tiller_model_t& arm = *tiller_find_model("two_link_arm");
  tiller_config_default(&config, &arm);
  std::vector<double> params;
  for (std::uint32_t i = 0; i < arm.param_count; ++i) params.push_back(0.4 + 0.1 * i);
  constexpr double kPeriod_s = 0.01;
  const auto place = [](std::uint32_t j, double t) { return 0.3 + 0.7 * std::sin((2.0 + j) * t + j); };
  const auto rate = [](std::uint32_t j, double t) { return 0.7 * (2.0 + j) * std::cos((2.0 + j) * t + j); };
  const auto state_at = [&](double t, double* x) {
    for (std::uint32_t j = 0; j < 2; ++j) {
      x[arm.joints[j].position] = place(j, t);
      x[arm.joints[j].velocity] = rate(j, t);
    }
  };
  const auto tip_x = [&](double t) {
    double x[TILLER_MAX_STATES], y[TILLER_MAX_OUTPUTS];
    state_at(t, x);
    arm.outputs(x, params.data(), y);
    return y[0];
  };
  const auto tip_rate = [&](double t) { return (tip_x(t + 1e-5) - tip_x(t - 1e-5)) / 2e-5; };
  std::vector<double> path(40 * arm.state_count);
  for (std::size_t k = 0; k < 40; ++k) state_at(static_cast<double>(k) * kPeriod_s, &path[k * arm.state_count]);

  const char* const elbow = arm.state_names[arm.joints[1].position];
  const char* const elbow_rate = arm.state_names[arm.joints[1].velocity];
  ASSERT_STREQ(arm.output_names[0], "tip_x_m");
  const Gauges gauges(config, {sensor("tip_x_m", 0), sensor("tip_x_m", 1), sensor("tip_x_m", 2), sensor(elbow, 1),
                               sensor(elbow_rate, 1)});
  const auto read = [&](std::size_t g) { return gauges.reading(g, path.data(), 20, 1, params.data(), 1, kPeriod_s); };
  EXPECT_NEAR(read(0), tip_x(0.2), 1e-12);
  EXPECT_NEAR(read(1), tip_rate(0.2), 1e-6);
  EXPECT_NEAR(read(2), (tip_rate(0.2) - tip_rate(0.19)) / kPeriod_s, 1e-4);
  EXPECT_NEAR(read(3), rate(1, 0.2), 1e-12);
  EXPECT_NEAR(read(4), (rate(1, 0.2) - rate(1, 0.19)) / kPeriod_s, 1e-10);
  EXPECT_EQ(gauges.before(1), 0u);
  EXPECT_EQ(gauges.before(2), 1u);
  double slope[TILLER_MAX_STATES], moved[TILLER_MAX_STATES], y[TILLER_MAX_OUTPUTS];
  gauges.slope(0, &path[20 * arm.state_count], params.data(), slope);
  state_at(0.2, moved);
  moved[arm.joints[1].position] += 1e-6;
  arm.outputs(moved, params.data(), y);
  EXPECT_NEAR(slope[arm.joints[1].position], (y[0] - tip_x(0.2)) / 1e-6, 1e-5);
}

TEST(Gauges, KnowWhatTheJointsTellTheRateOf) {
  const tiller_model_t &base = *tiller_find_model("skid_steer"), &arm = *tiller_find_model("two_link_arm");
  EXPECT_FALSE(joints_tell_rate(base, base.state_names[0]));
  EXPECT_TRUE(joints_tell_rate(arm, arm.state_names[arm.joints[0].position]));
  EXPECT_FALSE(joints_tell_rate(arm, arm.state_names[arm.joints[0].velocity]));
  EXPECT_TRUE(joints_tell_rate(arm, "tip_x_m"));
}

constexpr double kArm_m = 0.4, kAngle_rad = 0.3;  // where the frame stands on the swing, and how it is turned

/// A swing on a slide, with a frame on it that turns with the swing.
const tiller_model_t& swing_on_a_slide() {
  static const char* const states[] = {"slide_m", "swing_rad", "slide_m_s", "swing_rad_s"};
  static const char* const inputs[] = {"slide_N"};
  static const char* const forces[] = {"slide_N", "swing_Nm"};
  static const tiller_joint_t joints[] = {{"slide", 0, 2, 0, 1}, {"swing", 1, 3, 1, 0}};
  static const auto names = frame_output_names("imu");
  static const char* output_names[12];
  for (std::size_t i = 0; i < 12; ++i) output_names[i] = names[i].c_str();
  static tiller_model_t model{};
  model.size = sizeof model;
  model.version = TILLER_MODEL_VERSION;
  model.name = "swing on a slide";
  model.state_count = 4;
  model.input_count = 1;
  model.joint_count = 2;
  model.state_names = states;
  model.input_names = inputs;
  model.force_names = forces;
  model.joints = joints;
  model.dynamics = [](const double*, const double*, const double*, const tiller_body_t*, const double*, double*) {};
  model.output_count = 12;
  model.output_names = output_names;
  model.outputs = [](const double* x, const double*, double* y) {
    const double a = x[1], b = a + kAngle_rad;
    const double pose[] = {x[0] + kArm_m * std::cos(a),
                           0,
                           kArm_m * std::sin(a),
                           std::cos(b),
                           0,
                           -std::sin(b),
                           0,
                           1,
                           0,
                           std::sin(b),
                           0,
                           std::cos(b)};
    std::copy(std::begin(pose), std::end(pose), y);
  };
  return model;
}

// Against the kinematics by hand: the slide's acceleration and the swing's, radial and across, turned into the frame,
// and gravity with them.
TEST(Gauges, AnAccelerometerTurnsWithItsFrameAndFeelsGravity) {
  tiller::Config config;
  tiller_config_default(&config, &swing_on_a_slide());
  config.body.gravity_x_m_s2 = 1.0;  // on a slope
  config.body.gravity_z_m_s2 = -9.0;
  GridSensor along = sensor("imu_x_m", 2), upwards = sensor("imu_z_m", 2);
  along.is.accelerometer = upwards.is.accelerometer = true;
  const Gauges gauges(config, {along, upwards});
  EXPECT_EQ(gauges.before(0), 1u);
  constexpr double kPeriod_s = 0.002;
  double path[8];
  for (std::size_t k = 0; k < 2; ++k) {
    const double t = 0.3 + static_cast<double>(k) * kPeriod_s;
    const double at[] = {0.2 * std::sin(3 * t), 0.8 * std::sin(2 * t), 0.6 * std::cos(3 * t), 1.6 * std::cos(2 * t)};
    std::copy(std::begin(at), std::end(at), path + 4 * k);
  }
  const double t = 0.3 + 0.5 * kPeriod_s, a = 0.8 * std::sin(2 * t), rate = 1.6 * std::cos(2 * t);
  const double slide = -1.8 * std::sin(3 * t), turn = -3.2 * std::sin(2 * t), b = a + kAngle_rad;
  const double x = slide - kArm_m * (turn * std::sin(a) + rate * rate * std::cos(a)) - 1.0;
  const double z = kArm_m * (turn * std::cos(a) - rate * rate * std::sin(a)) + 9.0;
  const double none[1] = {};
  // a change over 2 ms stands for the slope at its middle: 1/24 of the third derivative times the square, 1e-6
  EXPECT_NEAR(gauges.reading(0, path, 1, 1, none, 1, kPeriod_s), std::cos(b) * x + std::sin(b) * z, 2e-5);
  EXPECT_NEAR(gauges.reading(1, path, 1, 1, none, 1, kPeriod_s), std::cos(b) * z - std::sin(b) * x, 2e-5);
  // by the speeds, along the axis as it stands
  double slope[4];
  gauges.slope(0, path, none, slope);
  EXPECT_NEAR(slope[2], std::cos(path[1] + kAngle_rad), 1e-6);
  EXPECT_NEAR(slope[3], kArm_m * std::sin(kAngle_rad), 1e-6) << "across the arm, seen from the turned frame";
}

Synthetic cart(double accelerometer_sd) {
  Synthetic s;
  s.model = tiller_find_model("cart_pole");
  s.params = {1.0, 0.2, 0.3};
  s.amplitude = 8;
  s.noise_sd = 2e-3;
  s.accelerometer_sd = accelerometer_sd;
  return s;
}

Result run(const Synthetic& s, std::uint64_t seed) {
  tiller::Config config = synthetic_config(s);
  for (const tiller_joint_t* joint = s.model->joints; joint != s.model->joints + s.model->joint_count; ++joint)
    config.process_sd[joint->velocity] = s.process_sd;
  Options options;
  options.max_effects = 2;
  const Result r = find_gap_on(config, {"cart_mass_kg", "pole_mass_kg", "half_length_m"}, simulate_logs(s, 4, seed),
                               std::vector<Grid>(), options);
  std::printf("   %s\n", r.sentence.c_str());
  return r;
}

// A motor's lag of a few milliseconds hardly shows in positions; an accelerometer sees the force.
TEST(Gauges, AnAccelerometerSharpensALag) {
  double sd[2];
  for (const bool with : {false, true}) {
    Synthetic s = cart(with ? 0.02 : 0.0);
    s.lag_s = 0.008;
    const Result r = run(s, 100070);
    ASSERT_EQ(r.verdict, Verdict::named);
    ASSERT_EQ(r.ranking.front().effects.size(), 1u);
    EXPECT_STREQ(effect_info(r.ranking.front().effects[0].kind).name, "actuator_lag");
    const Estimate& lag = r.ranking.front().params.back();
    EXPECT_NEAR(lag.mean, s.lag_s, 4 * lag.sd);
    sd[with] = lag.sd;
  }
  EXPECT_LT(sd[1], 0.5 * sd[0]);
}

// Kicks of the process are no gap: what the filter expects of the accelerometer holds.
TEST(Gauges, AreWhiteWhereNothingIsMissing) {
  for (const double process_sd : {0.0, 0.05}) {
    Synthetic s = cart(0.1);
    s.process_sd = process_sd;
    const Result r = run(s, 100071);
    EXPECT_EQ(r.verdict, Verdict::no_gap) << process_sd;
    EXPECT_NEAR(r.nominal_sigma, 1.0, 0.05) << process_sd;
  }
}

// An angle's column that wraps where the robot's own does not, or the other way round, is the same angle.
TEST(Gauges, AnAngleMayWrap) {
  Synthetic s = cart(0);
  tiller::Config config = synthetic_config(s);
  std::vector<Grid> grids = simulate_logs(s, 2, 100072);
  Rng rng(100072, 5, 5);
  for (Grid& grid : grids) {
    GridSensor angle = sensor("angle_rad", 0);
    for (const double value : grid.state[1])  // hangs at pi
      angle.value.push_back(std::remainder(value + 0.01 * rng.normal(), 2 * M_PI));
    grid.sensor.push_back(angle);
  }
  Options options;
  options.max_effects = 1;
  options.only = {"viscous_friction"};
  const Result r = find_gap_on(config, {"cart_mass_kg", "pole_mass_kg", "half_length_m"}, grids, {}, options);
  EXPECT_EQ(r.verdict, Verdict::no_gap) << r.sentence;
  EXPECT_NEAR(r.nominal_sigma, 1.0, 0.05);
}

}  // namespace
}  // namespace tiller::tools::gap
