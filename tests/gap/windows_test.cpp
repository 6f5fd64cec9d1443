// Which stretches of a log are rolled out, and what was commanded before it.
#include <gtest/gtest.h>

#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/gap/fit/fine_steps.hpp"
#include "tools/gap/fit/windows.hpp"

namespace tiller::tools::gap {
namespace {

// A pendulum at an angle, of which nothing else is known than these rows.
Grid still(double angle, double command, std::size_t points) {
  Rng rng(100031, 1, 1);
  Grid grid;
  grid.period_s = 0.01;
  grid.state.resize(2);
  for (std::size_t k = 0; k < points; ++k) {
    // it leaves after half a second
    const double t = std::max(0.0, 0.01 * static_cast<double>(k) - 0.5);
    grid.state[0].push_back(angle + 0.5 * t * t + 3e-4 * rng.normal());
    grid.state[1].push_back(NAN);
  }
  grid.input.assign(1, std::vector<double>(points, command));
  return grid;
}

std::size_t points_in(const std::vector<Window>& windows) {
  std::size_t sum = 0;
  for (const Window& w : windows) sum += w.points;
  return sum;
}

TEST(Windows, BeginWithALogThatBeginsAtRest) {
  const tiller::Config config = synthetic_config({});
  const WindowData data = make_window_data({still(0.1, 0, 300)}, config);
  EXPECT_TRUE(data.begins_at_rest[0]);
  const std::vector<Window> windows = make_windows(data, config, 1.0, 0, 1);
  ASSERT_EQ(windows.size(), 3u);
  EXPECT_EQ(windows[0].start, 0u);
  EXPECT_EQ(windows[0].run_in_steps, 0u);
  EXPECT_NEAR(windows[0].x0[0], 0.1, 1e-3);
  EXPECT_EQ(windows[0].x0[1], 0.0);
  EXPECT_EQ(windows[1].start - windows[1].run_in_steps, 75u);
  EXPECT_EQ(points_in(windows), 300u);
}

TEST(Windows, RunInWhereALogBeginsInMotion) {
  Synthetic s;
  s.noise_sd = 3e-4;
  s.seconds = 4;
  Grid grid = simulate(s, 100032);
  grid = part_of(grid, 100, 400);
  grid.log_start_s = grid.first_time_s;
  const tiller::Config config = synthetic_config(s);
  const WindowData data = make_window_data({grid}, config);
  EXPECT_FALSE(data.begins_at_rest[0]);
  const std::vector<Window> windows = make_windows(data, config, 1.0, 0, 1);
  ASSERT_EQ(windows.size(), 2u);
  EXPECT_GE(windows[0].start, windows[0].run_in_steps);
  EXPECT_EQ(windows[0].run_in_steps, 25u);
  EXPECT_EQ(data.commands_before[0][0], grid.input[0][0]);
}

TEST(Windows, ADriveWasOffUnlessItHolds) {
  const Synthetic s;
  const tiller::Config config = synthetic_config(s);
  const double holds = s.params[0] * 9.81 * s.params[1] * std::sin(0.8);
  const WindowData data = make_window_data({still(0, 0.4, 300), still(0.8, holds, 300)}, config);
  EXPECT_EQ(data.commands_before[0][0], 0.0);
  EXPECT_EQ(data.commands_before[1][0], holds);
}

TEST(Windows, AVehicleRestsWhileItsPlaceDoes) {
  tiller::Config config;
  tiller_config_default(&config, tiller_find_model("skid_steer"));
  config.period_s = 0.025;
  const double params[] = {0.1, 0.4, 0.0};
  for (std::uint32_t i = 0; i < 3; ++i) config.priors[i] = {tiller_prior_fixed, 0, params[i], 0, params[i], params[i]};
  config.measurement_count = 3;
  for (std::uint8_t i = 0; i < 3; ++i) {
    config.measured_state[i] = i;
    config.measurement_sd[i] = 0.002;
  }
  for (const double first_m_s : {0.0, 0.4}) {
    Grid grid;
    grid.period_s = 0.025;
    grid.state.assign(3, std::vector<double>(120, 0.0));
    for (std::size_t k = 1; k < 120; ++k) grid.state[0][k] = grid.state[0][k - 1] + 0.025 * (k < 5 ? first_m_s : 0.4);
    grid.input.assign(2, std::vector<double>(120, 4.0));
    const WindowData data = make_window_data({grid}, config);
    EXPECT_EQ(data.begins_at_rest[0], first_m_s == 0);
    EXPECT_EQ(data.commands_before[0][0], first_m_s == 0 ? 0.0 : 4.0);
    EXPECT_EQ(make_windows(data, config, 1.0, 0, 1).size(), first_m_s == 0 ? 3u : 2u);
  }
}

// A rod of 0.3 kg behind the spring and damper of a load cell, whose force is a state. Its pair of eigenvalues has the
// size sqrt(k / m) = 577 1/s; 0.15 of that motion is 0.26 ms. A pendulum has joints alone and takes 2.5 ms.
TEST(FineSteps, FollowAStateBehindAJoint) {
  tiller_model_t rod = {};
  rod.state_count = 3;
  rod.input_count = 1;
  rod.joint_count = 1;
  static const tiller_joint_t joints[] = {{"rod", 0, 2, 0, 1}};
  rod.joints = joints;
  rod.dynamics = [](const double* x, const double* u, const double* f, const tiller_body_t*, const double*,
                    double* dx) {
    dx[0] = x[2];
    dx[1] = 1e5 * x[2];
    dx[2] = (u[0] + f[0] - x[1] - 200 * x[2]) / 0.3;
  };
  Grid grid;
  grid.period_s = 0.01;
  grid.state = {std::vector<double>(100, 0.02), std::vector<double>(100, 100.0), {}};
  grid.input = {std::vector<double>(100, 100.0)};
  tiller::Config config;
  config.model = &rod;
  config.period_s = 0.01;
  config.substeps = 1;
  EXPECT_EQ(with_fine_steps(config, grid).substeps, 39u);  // 0.01 * 577.35 / 0.15 = 38.5
  config.substeps = 50;
  EXPECT_EQ(with_fine_steps(config, grid).substeps, 50u) << "the robot file's own are finer";

  config.model = tiller_find_model("pendulum");
  config.substeps = 1;
  grid.state.pop_back();
  EXPECT_EQ(with_fine_steps(config, grid).substeps, 4u);
}

}  // namespace
}  // namespace tiller::tools::gap
