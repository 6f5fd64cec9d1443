// Forces that no catalogue has, learnt from the logs of pendulums with an integrator of their own.

#include "tools/learn/learn.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>

#include "hidden_pendulum.hpp"
#include "tools/learn/learnt_writer.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools::learn {
namespace {

constexpr const char* kRobot = R"([robot]
name = "hidden"
[model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { normal = [0.5, 0.025] }
length_m = 0.5
damping_Nms = 0.02
[measurement]
angle_rad = { sd = 3e-4 }
[limits]
torque_Nm = { low = -5.0, high = 5.0 }
[noise]
process_sd = { rate_rad_s = 0.01 }  # of the file
)";

std::unique_ptr<RobotFile> robot_of(const std::string& text, const std::string& path = "hidden.toml") {
  std::string error;
  auto robot = parse_robot_file(text, path, error);
  EXPECT_TRUE(robot) << error;
  return robot;
}

std::vector<double> true_params(const hidden::Setup& s) { return {s.mass_kg, s.length_m, s.damping_Nms}; }

TEST(ForceSmoother, FindsTheForceThatActs) {
  const hidden::Setup setup;
  const auto robot = robot_of(kRobot);
  const std::vector<Grid> grids = hidden::logs(setup, hidden::spring_q2, 2, 3);
  const std::vector<double> params = true_params(setup);
  const Eigen::VectorXd typical = typical_forces(robot->config, grids, params);
  ASSERT_GT(typical(0), 0.0);
  const Eigen::VectorXd sd = choose_force_sd(robot->config, grids, params, typical);
  SmoothedForces forces;
  std::string error;
  ASSERT_TRUE(smooth_forces(robot->config, grids, params, sd, forces, error)) << error;
  double errors = 0.0, squares = 0.0, normalised = 0.0, count = 0.0;
  for (Eigen::Index k = 0; k < forces.force.cols(); ++k) {
    if (forces.weight[static_cast<std::size_t>(k)] == 0.0) continue;
    const double wanted = hidden::spring_q2(forces.state(0, k), forces.state(1, k));
    errors += std::pow(forces.force(0, k) - wanted, 2);
    normalised += std::pow(forces.force(0, k) - wanted, 2) / forces.variance(0, k);
    squares += wanted * wanted;
    count += 1.0;
  }
  EXPECT_LT(std::sqrt(errors / squares), 0.2);
  // the smoother's own deviation is that of its errors, to the factor of three in which intensities are tried
  EXPECT_LT(std::sqrt(normalised / count), 3.0);
  EXPECT_GT(std::sqrt(normalised / count), 1.0 / 3.0);
}

LearnOptions quick(Form form) {
  LearnOptions options;
  options.form = form;
  options.ensemble.steps = 500;
  options.ensemble.batch = 128;
  options.ensemble.members = 3;
  options.passes = 2;
  options.gaussian.hyper_samples = 100;
  options.gaussian.hyper_steps = 40;
  options.gaussian.inducing = 24;
  options.gaussian.waves = 32;
  options.gaussian.members = 4;
  return options;
}

/// RMS error of rollouts of a second on logs that nothing has seen, with what was learnt over without.
double fresh_ratio(const RobotFile& robot, const Learnt& learnt, const std::vector<Grid>& fresh) {
  const std::vector<Eigen::MatrixXd> states = filtered_states(robot.config, fresh, learnt.base, learnt.force_sd);
  Hypotheses who = {&robot.config, {learnt.params}, learnt.before_process_sd};
  const double before = judge_rollouts(who, fresh, states).rms_sigma;
  const Candidate& c = learnt.candidates[static_cast<std::size_t>(learnt.chosen)];
  const LoadedNetwork loaded(c.network);
  Config with;
  EXPECT_TRUE(with_network(robot.config, loaded, with));
  who = {&with, {}, c.process_sd};
  for (std::uint32_t m = 0; m < c.network.members; ++m) {
    who.params.push_back(learnt.base);
    who.params.back().push_back(m + 0.5);
  }
  return judge_rollouts(who, fresh, states).rms_sigma / before;
}

class EveryForm : public ::testing::TestWithParam<Form> {};
INSTANTIATE_TEST_SUITE_P(Learn, EveryForm, ::testing::Values(Form::network, Form::gaussian),
                         [](const auto& test) { return test.param == Form::network ? "network" : "gaussian"; });

TEST_P(EveryForm, ShrinksTheGapOnLogsThatItHasNotSeen) {
  const hidden::Setup setup;
  const auto robot = robot_of(kRobot);
  Learnt learnt;
  std::string error;
  ASSERT_TRUE(learn(*robot, hidden::logs(setup, hidden::spring_q2, 4, 11), quick(GetParam()), learnt, error)) << error;
  ASSERT_EQ(learnt.chosen, 0) << learnt.why;
  // the nine local weights come to a fifth on these worlds (tests/gap/fallback_test.cpp)
  EXPECT_LT(fresh_ratio(*robot, learnt, hidden::logs(setup, hidden::spring_q2, 3, 12)), 0.35);
  EXPECT_GT(learnt.candidates[0].spread_ratio, 1.5);
  EXPECT_GE(learnt.candidates[0].held_out.covered, 0.85);
}

TEST(Learn, RefusesWhereNothingIsMissing) {
  const auto robot = robot_of(kRobot);
  Learnt learnt;
  std::string error;
  const LearnOptions options = quick(Form::automatic);
  ASSERT_TRUE(learn(*robot, hidden::logs({}, hidden::nothing, 3, 5), options, learnt, error)) << error;
  EXPECT_EQ(learnt.chosen, -1) << learnt_text(learnt);
  EXPECT_NE(learnt.why.find("refused"), std::string::npos);
}

TEST(Learn, TheNewRobotFileReadsBackAndKeepsTheOldText) {
  const auto robot = robot_of(kRobot);
  LearnOptions options = quick(Form::network);
  options.ensemble.members = 2;
  options.passes = 1;
  Learnt learnt;
  std::string error;
  ASSERT_TRUE(learn(*robot, hidden::logs({}, hidden::spring_q2, 4, 8), options, learnt, error)) << error;
  ASSERT_EQ(learnt.chosen, 0) << learnt.why;
  const char* folder = std::getenv("TEST_TMPDIR");
  const std::string path = std::string(folder ? folder : ".") + "/";
  ASSERT_TRUE(save_network(path + "net.json", learnt.candidates[0].network, error)) << error;
  std::string text;
  ASSERT_TRUE(learnt_robot_text(*robot, kRobot, learnt, "net.json", text, error)) << error;
  EXPECT_NE(text.find("# of the file"), std::string::npos);
  const auto after = robot_of(text, path + "after.toml");
  ASSERT_TRUE(after);
  ASSERT_EQ(after->config.effect_count, 1u);
  EXPECT_EQ(after->config.effects[0].kind, static_cast<std::uint32_t>(tiller_effect_network));
  EXPECT_EQ(after->config.priors[3].high, 2.0) << "a member for each network that there is";
  EXPECT_EQ(after->network->stored.weights, learnt.candidates[0].network.weights) << "to the last bit";
  EXPECT_GE(after->config.process_sd[1], 0.01);
  EXPECT_NEAR(after->config.priors[0].a, learnt.base[0], 1e-6) << "the mass that it was learnt on";
  const std::string json = learnt_json(*robot, learnt, "after.toml");
  EXPECT_NE(json.find("\"chosen\": \"network\""), std::string::npos);
  Learnt again;
  EXPECT_FALSE(learn(*after, hidden::logs({}, hidden::spring_q2, 1, 8), options, again, error));
  EXPECT_NE(error.find("already"), std::string::npos);
}

TEST(Learn, ShortLogsAreHeldOutWhole) {
  const auto robot = robot_of(kRobot);
  hidden::Setup setup;
  setup.seconds = 3.0;  // the last quarter is shorter than a rollout
  LearnOptions options = quick(Form::gaussian);
  options.gaussian.hyper_samples = 60;
  options.passes = 1;
  Learnt learnt;
  std::string error;
  ASSERT_TRUE(learn(*robot, hidden::logs(setup, hidden::spring_q2, 4, 9), options, learnt, error)) << error;
  EXPECT_GT(learnt.before.rollouts, 0u);
  EXPECT_TRUE(std::isfinite(learnt.before.rms_sigma));
  Learnt again;
  EXPECT_FALSE(learn(*robot, hidden::logs(setup, hidden::spring_q2, 1, 9), options, again, error));
  EXPECT_NE(error.find("3.0 s"), std::string::npos) << error;
}

TEST(Learn, TellsWhatTheLogsLack) {
  const auto robot = robot_of(kRobot);
  std::vector<Grid> still = hidden::logs({}, hidden::nothing, 1, 5);
  for (double& q : still[0].state[0]) q = 0.0;
  for (double& u : still[0].input[0]) u = 0.0;
  Learnt learnt;
  std::string error;
  EXPECT_FALSE(learn(*robot, still, quick(Form::network), learnt, error));
  EXPECT_NE(error.find("never move"), std::string::npos) << error;
  for (double& q : still[0].state[0]) q = NAN;
  learnt = Learnt{};
  EXPECT_FALSE(learn(*robot, still, quick(Form::network), learnt, error));
}

}  // namespace
}  // namespace tiller::tools::learn
