// The one smoother of logs: forces that are known come back within their own deviations, whatever the log lacks.

#include "tools/smooth/smoother.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/gap/synthetic.hpp"
#include "tools/smooth/forces.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {
namespace {

double push(double t) { return 0.2 * std::sin(3 * t); }

gap::Synthetic pushed_pendulum() {
  gap::Synthetic s;
  s.amplitude = 0.8;
  s.force = [](double, double, double, double t) { return push(t); };
  return s;
}

/// The intensity at which a walk follows push(): the root mean square of its slope, 0.42 N m / s, over what a walk of
/// intensity s has within the 0.1 s in which the sensor tells a force.
SmoothSettings walking() {
  SmoothSettings settings;
  settings.force_sd = Eigen::VectorXd::Constant(1, 0.3);
  return settings;
}

struct Errors {
  double rms = 0, normalised = 0;  // of the force, and over its own deviation
};
Errors errors_of(const SmoothedGrid& smoothed, double period_s, double (*truth)(double)) {
  Errors e;
  const Eigen::Index n = smoothed.force.cols();
  for (Eigen::Index k = 0; k < n; ++k) {
    const double t = static_cast<double>(smoothed.first + static_cast<std::size_t>(k)) * period_s;
    const double square = std::pow(smoothed.force(0, k) - truth(t), 2);
    e.rms += square / static_cast<double>(n);
    e.normalised += square / smoothed.force_variance(0, k) / static_cast<double>(n);
  }
  return {std::sqrt(e.rms), std::sqrt(e.normalised)};
}

SmoothedGrid smoothed_of(const tiller_config_t& config, const std::vector<double>& params, const Grid& grid,
                         const SmoothSettings& settings) {
  SmoothedGrid out;
  std::string error;
  EXPECT_TRUE(smooth_grid(config, params, grid, settings, out, error)) << error;
  return out;
}

TEST(Smoother, AForceComesBackWithinItsDeviation) {
  const gap::Synthetic s = pushed_pendulum();
  const Config config = gap::synthetic_config(s);
  const SmoothedGrid out = smoothed_of(config, s.params, gap::simulate(s, 1), walking());
  ASSERT_EQ(out.first, 0u);
  ASSERT_EQ(out.force.cols(), 800);
  const Errors e = errors_of(out, s.period_s, push);
  EXPECT_LT(e.rms, 0.05);        // a quarter of the push
  EXPECT_LT(e.normalised, 1.5);  // a force that is smoother than a walk is better known than the walk's deviation says
  EXPECT_GT(e.normalised, 0.3);
  EXPECT_NEAR(out.misfit, 1, 0.1);
}

TEST(Smoother, WhereReadingsAreMissingItKnowsLess) {
  const gap::Synthetic s = pushed_pendulum();
  const Config config = gap::synthetic_config(s);
  Grid grid = gap::simulate(s, 1);
  for (std::size_t k = 400; k < 440; ++k) grid.state[0][k] = NAN;
  const SmoothedGrid out = smoothed_of(config, s.params, grid, walking());
  EXPECT_GT(out.force_variance(0, 420), 1.5 * out.force_variance(0, 300));
  EXPECT_GT(out.state_variance(0, 420), 4 * out.state_variance(0, 300));
  EXPECT_LT(errors_of(out, s.period_s, push).normalised, 1.5);
}

TEST(Smoother, BeginsWhereTheSensorIsRead) {
  const gap::Synthetic s = pushed_pendulum();
  const Config config = gap::synthetic_config(s);
  Grid grid = gap::simulate(s, 1);
  for (std::size_t k = 0; k < 30; ++k) grid.state[0][k] = NAN;
  const SmoothedGrid out = smoothed_of(config, s.params, grid, walking());
  EXPECT_EQ(out.first, 30u);
  EXPECT_EQ(out.force.cols(), 770);
  EXPECT_LT(errors_of(out, s.period_s, push).normalised, 1.5);
  for (double& angle : grid.state[0]) angle = NAN;
  EXPECT_EQ(smoothed_of(config, s.params, grid, walking()).force.cols(), 0);
}

/// An angle that a log wraps is no jump.
TEST(Smoother, AngleThatWrapsIsNoForce) {
  gap::Synthetic s = pushed_pendulum();
  s.amplitude = 4;  // turns over
  const Config config = gap::synthetic_config(s);
  Grid grid = gap::simulate(s, 1);
  double most = 0;
  for (double& angle : grid.state[0]) {
    most = std::max(most, std::fabs(angle));
    angle = std::remainder(angle, 6.283185307179586);
  }
  ASSERT_GT(most, 3.2);
  EXPECT_LT(errors_of(smoothed_of(config, s.params, grid, walking()), s.period_s, push).rms, 0.05);
}

TEST(Smoother, ADelayThatTheModelHasIsNoForce) {
  gap::Synthetic s;
  s.amplitude = 0.8;
  s.delay_s = 0.02;
  const Grid grid = gap::simulate(s, 1);
  const auto none = [](double) { return 0.0; };
  Config config = gap::synthetic_config(s);
  const double without = errors_of(smoothed_of(config, s.params, grid, walking()), s.period_s, none).rms;
  config.effects[config.effect_count++] = {tiller_effect_input_delay, 0};
  config.priors[config.param_count++] = {tiller_prior_fixed, 0, s.delay_s, 0, s.delay_s, s.delay_s};
  std::vector<double> params = s.params;
  params.push_back(s.delay_s);
  const double with = errors_of(smoothed_of(config, params, grid, walking()), s.period_s, none).rms;
  EXPECT_LT(with, 0.5 * without);
}

TEST(Smoother, AnOffsetThatTheSensorHasIsNoForce) {
  gap::Synthetic s = pushed_pendulum();
  constexpr double kBias = 0.2;
  Grid grid = gap::simulate(s, 1);
  for (double& angle : grid.state[0]) angle += kBias;
  Config config = gap::synthetic_config(s);
  const double without = errors_of(smoothed_of(config, s.params, grid, walking()), s.period_s, push).rms;
  config.effects[config.effect_count++] = {tiller_effect_sensor_bias, 0};
  config.priors[config.param_count++] = {tiller_prior_fixed, 0, kBias, 0, kBias, kBias};
  std::vector<double> params = s.params;
  params.push_back(kBias);
  const double with = errors_of(smoothed_of(config, params, grid, walking()), s.period_s, push).rms;
  EXPECT_LT(with, 0.05);
  EXPECT_GT(without, 0.2);  // the weight at an angle of 0.2 rad is 0.39 N m
}

TEST(Smoother, AnErrorThatRepeatsWithThePositionIsNoForce) {
  gap::Synthetic s = pushed_pendulum();
  constexpr double kSine = 0.08, kPitch = 1.2;
  Grid grid = gap::simulate(s, 1);
  for (double& angle : grid.state[0]) angle += kSine * std::sin(2 * M_PI * angle / kPitch);
  Config config = gap::synthetic_config(s);
  const double without = errors_of(smoothed_of(config, s.params, grid, walking()), s.period_s, push).rms;
  config.effects[config.effect_count++] = {tiller_effect_encoder_eccentricity, 0};
  std::vector<double> params = s.params;
  for (const double value : {0.0, kSine, kPitch}) {
    config.priors[config.param_count++] = {tiller_prior_fixed, 0, value, 0, value, value};
    params.push_back(value);
  }
  const double with = errors_of(smoothed_of(config, params, grid, walking()), s.period_s, push).rms;
  EXPECT_LT(with, 0.06);  // 0.05 with a straight sensor, whose noise the slope does not widen
  EXPECT_GT(without, 2 * with);
}

TEST(GridRollout, AClockCountsFromTheLogsStart) {
  const gap::Synthetic s;
  Config config = gap::synthetic_config(s);
  config.effects[config.effect_count++] = {tiller_effect_gain_drift, 0};
  config.priors[config.param_count++] = {tiller_prior_fixed, 0, 0, 0, 0, 0};
  const Grid part = part_of(gap::simulate(s, 1), 300, 600);
  const GridRollout rollout(config, kLanePadding);
  EXPECT_NEAR(rollout.first_effect_state(part, 50)[0], 350 * s.period_s, 1e-12);
}

/// Without forces the process noise alone lets the log leave the model; where there is none, nothing does.
TEST(Smoother, WithoutForcesItIsTheModelsMotion) {
  gap::Synthetic s;
  s.amplitude = 0.8;
  const Grid grid = gap::simulate(s, 1);
  Config config = gap::synthetic_config(s);
  for (double& sd : config.process_sd) sd = 0;
  const SmoothedGrid out = smoothed_of(config, s.params, grid, {});
  EXPECT_EQ(out.force.rows(), 0);
  EXPECT_NEAR(out.misfit, 1, 0.1);
  double rms = 0;
  for (Eigen::Index k = 0; k < out.state.cols(); ++k)
    rms += std::pow(out.state(0, k) - grid.state[0][static_cast<std::size_t>(k)], 2) / 800.0;
  EXPECT_NEAR(std::sqrt(rms), s.noise_sd, 0.1 * s.noise_sd);
  EXPECT_LT(std::sqrt(out.state_variance.row(0).mean()), 0.2 * s.noise_sd);
}

TEST(Smoother, TheLikelihoodIsThatOfThePass) {
  const gap::Synthetic s = pushed_pendulum();
  const Config config = gap::synthetic_config(s);
  const std::vector<Grid> grids = gap::simulate_logs(s, 2, 1);
  double sum = 0;
  for (const Grid& grid : grids) sum += smoothed_of(config, s.params, grid, walking()).log_likelihood;
  EXPECT_NEAR(filter_log_likelihood(config, s.params, grids, walking()), sum, 1e-9 * std::fabs(sum));
}

TEST(Smoother, SaysWhereForcesHaveNoRoom) {
  const gap::Synthetic s = pushed_pendulum();
  Config config = gap::synthetic_config(s);
  config.effect_count = TILLER_MAX_EFFECTS;
  SmoothedGrid out;
  std::string error;
  EXPECT_FALSE(smooth_grid(config, s.params, gap::simulate(s, 1), walking(), out, error));
  EXPECT_NE(error.find("no room for 1 forces beside the robot's 32 effects"), std::string::npos) << error;
}

}  // namespace
}  // namespace tiller::tools
