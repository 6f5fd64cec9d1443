// Parts of the distiller against what they must be by themselves: moments, plants, fits, and a short course.
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "networks/evaluate.hpp"
#include "planners/policy_inputs.hpp"
#include "tools/distill/distill.hpp"
#include "tools/distill/lesson_plant.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools::distill {
namespace {

RobotFile robot_of(const std::string& name) {
  std::string errors;
  const auto robot = read_robot_file(std::string(TILLER_TEST_ROBOTS) + "/" + name + ".toml", errors);
  EXPECT_TRUE(robot) << errors;
  return robot ? *robot : RobotFile{};
}

/// The pendulum near upright under ilqr: what a small course can teach in a second.
RobotFile hold() {
  RobotFile robot = robot_of("pendulum");
  robot.config.planner.kind = tiller_planner_ilqr;
  robot.config.planner.horizon = 30;
  robot.config.planner.particles = 1;
  robot.config.initial_state[0] = 3.0;
  robot.config.initial_state_sd[0] = 0.1;
  robot.config.initial_state_sd[1] = 0.3;
  return robot;
}

DistillOptions short_course() {
  DistillOptions o;
  o.hidden = {12};
  o.iterations = 2;
  o.episodes = 10;
  o.seconds = 1;
  o.validation = 4;
  o.test = 0;
  return o;
}

TEST(PriorMoments, AreThoseOfThePrior) {
  Config c = robot_of("pendulum").config;
  c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 2.0, 5.0};
  c.priors[1] = {tiller_prior_fixed, 0, 0.5, 0, 0, 0};
  c.priors[2] = {tiller_prior_normal, 0, 1.0, 0.2, 0.0, 2.0};
  const PriorMoments moments = prior_moments(c);
  EXPECT_NEAR(moments.mean[0], 3.5, 0.15);  // 512 draws of sd 0.87: four standard errors
  EXPECT_NEAR(moments.sd[0], 3.0 / std::sqrt(12.0), 0.1);
  EXPECT_EQ(moments.mean[1], 0.5);
  EXPECT_EQ(moments.sd[1], 0.0);
  EXPECT_NEAR(moments.mean[2], 1.0, 0.04);
  EXPECT_NEAR(moments.sd[2], 0.2, 0.03);
}

/// Told belief and truth go together as those of a calibrated posterior: the truth is off by the told deviation.
TEST(BeliefStory, IsCalibrated) {
  Config c = robot_of("pendulum").config;
  c.priors[0] = {tiller_prior_normal, 0, 1.0, 0.1, -10.0, 10.0};
  const PriorMoments prior = prior_moments(c);
  for (const double time_s : {0.0, 0.05, 1.0, 20.0}) {
    double squares = 0, narrowest = 1e9;
    constexpr int kDraws = 4000;
    for (int i = 0; i < kDraws; ++i) {
      Rng rng(5, 1, static_cast<std::uint64_t>(i));
      BeliefStory story(c, prior, rng);
      story.tell(time_s);
      squares += std::pow((story.truth()[0] - story.mean()[0]) / story.sd()[0], 2) / kDraws;
      narrowest = std::min(narrowest, story.sd()[0]);
    }
    EXPECT_NEAR(squares, 1.0, 0.15) << time_s;  // prior moments by 512 draws: 6 % of the deviation
    EXPECT_LT(narrowest, time_s > 0 ? 0.05 : 0.11) << time_s;
  }
}

TEST(BeliefStory, DrawsHypothesesOfItsMoments) {
  const Config c = robot_of("pendulum").config;
  const PriorMoments prior = prior_moments(c);
  Rng rng(1, 1, 1);
  BeliefStory story(c, prior, rng);
  story.tell(5.0);
  std::vector<double> rows;
  story.draw(2000, rows);
  double mean = 0, squares = 0;
  for (std::size_t j = 0; j < 2000; ++j) {
    mean += rows[3 * j] / 2000;
    EXPECT_EQ(rows[3 * j + 1], 0.5) << "fixed";
  }
  for (std::size_t j = 0; j < 2000; ++j) squares += std::pow(rows[3 * j] - mean, 2) / 2000;
  EXPECT_NEAR(mean, story.mean()[0], 4 * story.sd()[0] / std::sqrt(2000.0) + 1e-9);
  EXPECT_NEAR(std::sqrt(squares), story.sd()[0], 0.15 * story.sd()[0]);
}

/// Semi-implicit steps of a tenth of a millisecond, written out, against the lesson's plant.
TEST(LessonPlant, MovesAsAPendulumDoes) {
  const Config c = robot_of("pendulum").config;
  StepSetup setup;
  ASSERT_EQ(make_step_setup(c, setup), tiller_status_ok);
  const double mass = 0.4, length = 0.5, damping = 0.05, torque = 0.7;
  LessonPlant plant(c, setup, {mass, length, damping});
  const double start[2] = {2.0, -0.5};
  plant.start(start);
  double angle = start[0], rate = start[1];
  for (int i = 0; i < 25; ++i) {
    plant.step(&torque);
    for (int k = 0; k < 200; ++k) {
      rate += 1e-4 * (torque - damping * rate - mass * 9.81 * length * std::sin(angle)) / (mass * length * length);
      angle += 1e-4 * rate;
    }
  }
  EXPECT_NEAR(plant.state()[0], angle, 2e-3);
  EXPECT_NEAR(plant.state()[1], rate, 5e-3);
}

TEST(Lesson, RepeatsAndDiffersByItsNumber) {
  const RobotFile robot = hold();
  const PriorMoments prior = prior_moments(robot.config);
  std::string error;
  const auto teacher = LonePlanner::make(robot.config, error);
  ASSERT_TRUE(teacher) << error;
  LessonOptions o;
  o.seconds = 0.5;
  o.reads = default_reads(robot);
  const LessonResult a = give_lesson(robot.config, prior, teacher.get(), nullptr, o);
  const LessonResult b = give_lesson(robot.config, prior, teacher.get(), nullptr, o);
  EXPECT_EQ(a.examples.in, b.examples.in);
  EXPECT_EQ(a.examples.share, b.examples.share);
  EXPECT_EQ(a.examples.count(), 25u * (1 + o.nearby));
  EXPECT_EQ(a.examples.in.size(), a.examples.count() * 7);  // sine, cosine, rate, two means, two deviations
  for (const double share : a.examples.share) EXPECT_LE(std::fabs(share), 1.0);
  o.number = 1;
  EXPECT_NE(give_lesson(robot.config, prior, teacher.get(), nullptr, o).examples.in, a.examples.in);
}

/// A function that a network of this size can be taught, and the stored policy must say what was taught.
TEST(Pupil, LearnsAndStoresWhatItLearnt) {
  const RobotFile robot = hold();
  Examples examples;
  Rng rng(3, 1, 0);
  const auto wanted = [](double sine, double rate, double mass) {
    return std::min(1.0, std::max(-1.0, 1.5 * sine - 0.3 * rate * mass));
  };
  for (std::uint32_t i = 0; i < 4000; ++i) {
    const double angle = 6.28 * rng.uniform(), rate = 4 * rng.uniform() - 2, mass = 0.3 + 0.4 * rng.uniform();
    const double sd = 0.1 * rng.uniform();
    examples.in.insert(examples.in.end(), {std::sin(angle), std::cos(angle), rate, mass, 0.05, sd, 0.02});
    examples.share.push_back(wanted(std::sin(angle), rate, mass));
    examples.of.push_back(i / 40);
  }
  Pupil pupil(robot, default_reads(robot), {16, 16}, 1);
  const StudyError error = pupil.study(examples, {});
  EXPECT_LT(error.held_out, 0.03);
  EXPECT_LT(error.trained, 0.03);
  const StoredPolicy stored = pupil.stored();
  const LoadedPolicy loaded(stored);
  double worst = 0;
  for (std::size_t i = 0; i < 4000; i += 13) {
    double out = 0;
    evaluate_member(loaded.loaded.network, 0, &examples.in[7 * i], &out);
    worst = std::max(worst, std::fabs(std::min(1.0, std::max(-1.0, out)) - examples.share[i]));
  }
  EXPECT_LT(worst, 0.2);  // in float, by the runtime
  EXPECT_EQ(stored.low[5], 0.0f) << "a posterior may know better than the examples";
  EXPECT_NEAR(stored.high[2], 2.0, 0.01);
}

TEST(Distill, TeachesAndIsTheSameForAnyThreads) {
  const RobotFile robot = hold();
  DistillOptions o = short_course();
  o.test = 1;
  const volatile std::sig_atomic_t stop = 0;
  Distilled one, two;
  std::string error;
  ASSERT_TRUE(distill(robot, o, stop, one, error)) << error;
  o.threads = 2;
  ASSERT_TRUE(distill(robot, o, stop, two, error)) << error;
  EXPECT_EQ(one.policy.network.weights, two.policy.network.weights);
  ASSERT_EQ(one.rounds.size(), 2u);
  // a tick in which the teacher takes its scout's plan has no gain for the two neighbours
  EXPECT_LE(one.rounds[1].samples, 2 * 10 * 50 * 3u);
  EXPECT_GT(one.rounds[1].samples, 2 * 10 * 50 * 2u);
  EXPECT_LT(one.rounds[one.best].cost_ratio, 1.3);
  ASSERT_EQ(one.tests.size(), 1u);
  EXPECT_FALSE(one.tests[0].policy_safe);
  EXPECT_LT(cost_ratio(one.tests), 1.5);
  EXPECT_GT(cost_ratio(one.tests), 0.5);
}

TEST(Distill, RefusesATeacherThatThereIsNot) {
  const RobotFile robot = hold();
  RobotFile out;
  std::string error;
  EXPECT_FALSE(with_teacher(robot, "oracle", out, error));
  EXPECT_NE(error.find("oracle"), std::string::npos) << error;
  EXPECT_NE(error.find("ilqr"), std::string::npos) << error;
  EXPECT_FALSE(with_teacher(robot, "policy", out, error));
  EXPECT_TRUE(with_teacher(robot, "mppi", out, error));
  EXPECT_EQ(out.config.planner.kind, tiller_planner_mppi);
}

TEST(HeldOut, DrawsWhatHasAPriorAndKeepsTheRest) {
  const RobotFile arm = robot_of("two_link_arm");
  const RobotFile a = held_out_draw(arm, 1), b = held_out_draw(arm, 2);
  EXPECT_EQ(a.sim.parameters.at("lower_mass_kg"), 0.8);
  ASSERT_EQ(a.sim.effects.size(), arm.sim.effects.size());
  for (std::size_t e = 0; e < a.sim.effects.size(); ++e)
    EXPECT_NE(a.sim.effects[e].parameters, b.sim.effects[e].parameters) << a.sim.effects[e].kind;
  EXPECT_EQ(a.config.seed, 1u);
}

TEST(PolicyRobot, ChangesThePlannerAndNothingElse) {
  const std::string text = "# mine\n[planner]\nhorizon = 9 # far\nkind = \"cem\"\n\n[cost]\ninput_weight = 1\n";
  std::string out, error;
  ASSERT_TRUE(policy_robot_text(text, "cem", "a\"b.json", out, error)) << error;
  EXPECT_NE(out.find("# mine\n"), std::string::npos);
  EXPECT_NE(out.find("horizon = 9 # far\nkind = \"policy\"\n"), std::string::npos) << out;
  EXPECT_NE(out.find("fallback = \"cem\"\n"), std::string::npos) << out;
  EXPECT_NE(out.find("[policy]\nfile = \"a\\\"b.json\"\n"), std::string::npos) << out;
  std::string twice;
  ASSERT_TRUE(policy_robot_text(out, "mppi", "c.json", twice, error)) << error;
  EXPECT_NE(twice.find("fallback = \"mppi\""), std::string::npos);
  EXPECT_EQ(twice.find("b.json"), std::string::npos) << twice;
  EXPECT_FALSE(policy_robot_text("planner = { kind = \"cem\" }\n", "cem", "a", out, error));
  EXPECT_NE(error.find("planner"), std::string::npos);
}

}  // namespace
}  // namespace tiller::tools::distill
