// Substeps are advised from where the robot goes, and a tick is told against its period.
#include "tools/open/substeps.hpp"
#include "tools/open/robot_open.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>
#include <filesystem>

#include "robot_text.hpp"
#include "tiller/config.hpp"
#include "tools/doctor/tick_forecast.hpp"
#include "tools/open/visited_states.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

/// A model file is compiled on the way.
class Substeps : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (std::filesystem::temp_directory_path() / "tiller-substeps-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
    setenv("TILLER_CACHE", folder_.c_str(), 1);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  static std::unique_ptr<RobotFile> quadrotor() {
    std::string errors;
    auto robot = read_robot_file(TILLER_TEST_QUADROTOR, errors);
    EXPECT_NE(robot, nullptr) << errors;
    return robot;
  }
  std::string folder_;
};

// Under inputs that nobody chose this quadrotor tumbles through its angles' singularity within its horizon, where any
// step is too long: judged there, it would need 32 substeps, and a tick would take most of a second.
TEST_F(Substeps, AQuadrotorIsJudgedInFlightNotWhereItTumbles) {
  const auto robot = quadrotor();
  ASSERT_NE(robot, nullptr);
  EXPECT_EQ(robot->substeps.needed, 1u);
  EXPECT_EQ(robot->config.substeps, 1u);
  EXPECT_LE(robot->substeps.configured.share, 0.1);
}

TEST_F(Substeps, TheVisitedStatesAreThoseOfTheTask) {
  const auto robot = quadrotor();
  ASSERT_NE(robot, nullptr);
  const VisitedStates path = visit_states(robot->config);
  ASSERT_EQ(path.count, 100u);  // two horizons: 2 s, twice what the way up takes
  const double* last = path.state.data() + std::size_t{path.count - 1} * 12;
  EXPECT_NEAR(last[0], 1.0, 0.2);  // [cost] target; a tenth of the way left
  EXPECT_NEAR(last[2], 2.0, 0.2);
  for (std::uint32_t k = 0; k < path.count; ++k) {
    EXPECT_LT(std::fabs(path.state[k * 12 + 3]), 1.0) << "rolls over at period " << k;
    EXPECT_LT(std::fabs(path.state[k * 12 + 4]), 1.0) << "pitches over at period " << k;
  }
  EXPECT_EQ(path.state, visit_states(robot->config).state) << "the same file gives the same advice";
}

TEST_F(Substeps, ThePathEndsWhereTheControllerWouldStop) {
  std::string errors;
  const auto robot =
      parse_robot_file(test::with("low = -2, high = 2", "low = -0.05, high = 0.05"), "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const VisitedStates path = visit_states(robot->config);
  ASSERT_GE(path.count, 1u);
  // what leaves the sensor's range is refused a few times before it is SAFE; the cart is no faster than 4 m/s by then
  const double margin = 4.0 * robot->config.period_s * robot->config.safety.bad_ticks_to_safe;
  for (std::uint32_t k = 0; k < path.count; ++k) EXPECT_LT(std::fabs(path.state[k * 4]), 0.05 + margin) << k;
}

// v' = -c v / m by Runge and Kutta's fourth order: with z = -c h / m the factor of a step is 1 + z + z^2/2 + z^3/6 +
// z^4/24, which leaves the unit circle at z = -2.785. A configuration must not get fewer substeps than that.
TEST_F(Substeps, AStiffModelGetsWhatItsStabilityAsksFor) {
  constexpr double kStability = 2.785;
  tiller::Config config;
  ASSERT_EQ(tiller_config_default(&config, tiller_find_model("pendulum")), tiller_status_ok);
  const auto known = [](double value) { return tiller_prior_t{tiller_prior_fixed, 0, value, 0, value, value}; };
  config.priors[0] = config.priors[1] = known(1.0);
  config.safety.input_low[0] = -5.0;
  config.safety.input_high[0] = 5.0;
  config.cost.state_weight[0] = 1.0;
  config.cost.target[0] = 1.0;
  config.process_sd[1] = 0.01;
  std::uint32_t before = 0;
  for (const double damping : {100.0, 500.0, 2000.0}) {
    config.priors[2] = known(damping);
    ASSERT_EQ(tiller_config_check(&config, nullptr), tiller_status_ok);
    const SubstepAdvice advice = advise_substeps(config);
    EXPECT_GE(advice.needed, damping * config.period_s / kStability) << damping;
    EXPECT_GE(advice.needed, before) << damping;
    EXPECT_LE(advice.advised.share, 0.1) << damping;
    config.substeps = advice.needed;
    EXPECT_EQ(advise_substeps(config).configured.share, advice.advised.share);
    config.substeps = 1;
    before = advice.needed;
  }
  EXPECT_GT(before, 8u);
}

TEST_F(Substeps, ATickIsToldAgainstItsPeriod) {
  std::string errors;
  const auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  TickForecast forecast;
  forecast.at_cap = {0.012, 1000000, 1e-8, 2};
  EXPECT_EQ(forecast_text(*robot, forecast),
            "12 ms predicted on one thread (1 million model steps of 10 ns, 2 ms beside them); period 20 ms");
  forecast.by_clock = forecast.at_cap;
  EXPECT_EQ(misfit_text(*robot, forecast), "");
  forecast.by_clock.tick_s = 1.1;
  const std::string text = misfit_text(*robot, forecast);
  for (const char* part : {"bench.toml", "predicted to take 1.1 s", "period of 20 ms", "deadline_us", "rollouts"})
    EXPECT_NE(text.find(part), std::string::npos) << part << " in " << text;
  // a deadline bounds the planner: only what was measured with it can contradict
  robot->config.planner.deadline_us = 15000;
  EXPECT_EQ(misfit_text(*robot, forecast), "");
  forecast.measured = true;
  EXPECT_NE(misfit_text(*robot, forecast).find("measures 1.1 s"), std::string::npos);
}

// The counted work times its measured cost is the tick: what stands beside it cannot be negative.
TEST_F(Substeps, AForecastCountsItsWork) {
  std::string errors;
  const auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  TickForecast forecast;
  std::string error;
  ASSERT_TRUE(forecast_tick(*robot, 0.01, true, forecast, error)) << error;
  const tiller_planner_config_t& p = robot->config.planner;
  EXPECT_GE(forecast.at_cap.steps,
            std::uint64_t{p.rollouts} * p.particles * p.horizon * p.iterations * robot->config.substeps);
  EXPECT_EQ(forecast.at_cap.iterations, p.iterations);
  EXPECT_GT(forecast.at_cap.step_s, 0.0);
  EXPECT_GE(forecast.at_cap.beside_s(), 0.0);
  EXPECT_TRUE(forecast.measured);
}

}  // namespace
}  // namespace tiller::tools
