// The worlds that `tiller gap` is scored on: what they promise to those who take them.

#include <gtest/gtest.h>

#include <cmath>

#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::bench {
namespace {

constexpr std::uint64_t kSeed = 100101;  // tuning seeds begin at 100001
const WorldSize kSmall{2, 1, 4.0};

std::unique_ptr<World> world(const CaseWanted& wanted) {
  WorldCase made;
  std::string error;
  EXPECT_TRUE(draw_case(wanted, made, error)) << error;
  auto world = make_world(made, error, kSmall);
  EXPECT_NE(world, nullptr) << error;
  return world;
}

CaseWanted wanted(const std::string& plant, std::vector<std::string> kinds = {}) {
  CaseWanted w;
  w.plant = plant;
  w.kinds = std::move(kinds);
  w.seed = kSeed;
  return w;
}

TEST(Worlds, WithoutAnEffectHaveNoGap) {
  for (const std::string& plant : world_plants()) {
    CaseWanted w = wanted(plant);
    w.noise_sd = 3e-4;
    const auto made = world(w);
    // the plants differ by where their first step took the rates from; a tenth of a deviation is nobody's gap
    EXPECT_LT(made->answer.r, 0.1) << plant;
    EXPECT_TRUE(made->answer.world.effects.empty());
    w.process_sd = 0.1;  // the same pushes in both: still no gap of an effect
    EXPECT_LT(world(w)->answer.r, 0.1) << plant;
  }
}

TEST(Worlds, RepeatToTheLastBitAndDifferBySeed) {
  CaseWanted w = wanted("cart_pole", {"wind_gusts"});
  const auto a = world(w), b = world(w);
  EXPECT_EQ(a->robot_toml, b->robot_toml);
  for (std::size_t i = 0; i < a->work.size(); ++i) EXPECT_EQ(series_csv(*a, a->work[i]), series_csv(*b, b->work[i]));
  EXPECT_EQ(sealed_json(a->answer, "x"), sealed_json(b->answer, "x"));
  EXPECT_NE(a->work[0].measured, a->work[1].measured);
  w.seed += 1;
  EXPECT_NE(world(w)->work[0].measured, a->work[0].measured);
}

TEST(Worlds, RobotFilesAreReadAndSayNothingOfTheEffect) {
  for (const std::string& plant : world_plants()) {
    const auto made = world(wanted(plant, {"coulomb_friction"}));
    std::string errors;
    const auto robot = tools::parse_robot_file(made->robot_toml, "robot.toml", errors);
    ASSERT_NE(robot, nullptr) << errors;
    EXPECT_EQ(robot->config.effect_count, 0u);
    EXPECT_EQ(made->robot_toml.find("friction"), std::string::npos);
    EXPECT_EQ(robot->names.states, made->states);
    EXPECT_EQ(robot->names.inputs, made->inputs);
    EXPECT_EQ(robot->names.measurements, made->measured);
    // the truth lies within what the file says
    for (std::size_t i = 0; i < made->answer.names.size(); ++i) {
      const int at = tools::index_of(robot->names.params, made->answer.names[i]);
      ASSERT_GE(at, 0) << made->answer.names[i];
      const tiller_prior_t& prior = robot->config.priors[at];
      if (prior.kind == tiller_prior_fixed) {
        EXPECT_EQ(prior.a, made->answer.values[i]);
      } else {
        EXPECT_GT(made->answer.values[i], prior.low);
        EXPECT_LT(made->answer.values[i], prior.high);
      }
    }
  }
}

TEST(Worlds, ReachTheStrengthThatIsAskedFor) {
  for (const std::string kind : {"viscous_friction", "input_delay", "backlash", "sensor_scale", "tilt"}) {
    CaseWanted w = wanted("pendulum", {kind});
    w.least_r = w.most_r = 10;
    const double r = world(w)->answer.r;
    // sought on the first run, taken over all: a factor of three
    EXPECT_GT(r, 10.0 / 3) << kind;
    EXPECT_LT(r, 10.0 * 3) << kind;
  }
}

TEST(Worlds, EveryKindCanBeHiddenInEveryPlantThatHasAPlaceForIt) {
  for (const std::string& plant : world_plants()) {
    EXPECT_GE(hidden_kinds(plant, true).size(), 27u) << plant;
    EXPECT_GE(hidden_kinds(plant, false).size(), 8u) << plant;
  }
  for (const bool in : {true, false}) {
    for (const std::string& kind : hidden_kinds("two_link_arm", in)) {
      WorldCase made;
      std::string error;
      EXPECT_TRUE(draw_case(wanted("two_link_arm", {kind}), made, error)) << kind << ": " << error;
      ASSERT_EQ(made.effects.size(), 1u);
      EXPECT_EQ(made.effects[0].kind, kind);
    }
  }
}

TEST(Worlds, APlannersCommandsAreWithinTheLimits) {
  CaseWanted w = wanted("pendulum", {"coulomb_friction"});
  w.excitation = Excitation::planner;
  const auto made = world(w);
  std::string errors;
  const auto robot = tools::parse_robot_file(made->robot_toml, "robot.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  double most = 0;
  for (const double u : made->work[0].input[0]) most = std::max(most, std::fabs(u));
  EXPECT_LE(most, robot->config.safety.input_high[0]);
  EXPECT_GT(most, 0.1 * robot->config.safety.input_high[0]);
}

}  // namespace
}  // namespace tiller::bench
