// What stands beside the log of a run for its page, and the units of what is shown.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "read_all.hpp"
#include "robot_text.hpp"
#include "tools/logs/run_log.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/task_clock.hpp"
#include "tools/robot/units.hpp"
#include "tools/run/run_facts.hpp"

namespace tiller::tools {
namespace {

std::unique_ptr<RobotFile> robot_of(const std::string& text) {
  std::string errors;
  auto robot = parse_robot_file(text, "bench.toml", errors);
  EXPECT_NE(robot, nullptr) << errors;
  return robot;
}

Words cells_of(std::string row) {
  Words cells;
  row += ",";
  for (std::size_t comma = row.find(','); comma != std::string::npos; comma = row.find(',')) {
    cells.push_back(row.substr(0, comma));
    row.erase(0, comma + 1);
  }
  return cells;
}

Words columns_of(const RobotFile& robot) {
  return cells_of(RunLog(robot, true, std::vector<double>(robot.names.params.size(), 1.0)).header());
}

Words keys_of(const nlohmann::json& object) {
  Words keys;
  for (const auto& item : object.items()) keys.push_back(item.key());
  return keys;
}

TEST(RunFacts, NameWhatEachColumnOfTheLogIs) {
  const auto robot = robot_of(test::kGoodRobot);
  const auto facts = nlohmann::ordered_json::parse(run_facts_json(*robot, RunResult{}, {"a run", "", true}));
  const auto& columns = facts["columns"];
  EXPECT_EQ(columns["states"].dump(),
            R"({"position_m":"m","angle_rad":"rad","velocity_m_s":"m/s","rate_rad_s":"rad/s"})");
  EXPECT_EQ(columns["angles"].dump(), R"(["angle_rad"])");
  EXPECT_EQ(columns["measured"].dump(), R"(["position_m","angle_rad"])");
  EXPECT_EQ(columns["inputs"].dump(), R"({"force_N":"N"})");
  EXPECT_EQ(columns["parameters"].dump(), R"({"pole_mass_kg":"kg","half_length_m":"m","cart.damping_SI":"N s/m"})");
}

TEST(RunFacts, TheAlarmSaysWhichForceIsLeftWhereForcesAreEstimated) {
  const auto robot = robot_of(test::kGoodRobot);
  RunResult result;
  result.inadequate_at_s = 2.5;
  result.info.adequacy = tiller_adequacy_inadequate;
  result.info.inadequate_channel = 1;
  result.info.inadequate_feature = tiller_feature_velocity_sign;
  const auto adequacy = [&] {
    const auto facts = nlohmann::ordered_json::parse(run_facts_json(*robot, result, {"a run", "", true}));
    return facts["facts"]["adequacy"].get<std::string>();
  };
  robot->config.posterior.disturbance = 0;
  EXPECT_EQ(adequacy(), "2.50 s: angle_rad, velocity_sign");
  robot->config.posterior.disturbance = 1;
  EXPECT_EQ(
      adequacy(),
      "2.50 s: angle_rad, velocity_sign: a force at joint 'pole' goes with its direction of motion (a dry friction "
      "that the model lacks)");
  result.info.inadequate_feature = tiller_feature_size;
  EXPECT_EQ(adequacy(), "2.50 s: angle_rad, size") << "noise is no force";
}

TEST(RunFacts, TellTheFigureInSumsOfNames) {
  const std::string figure = R"(
[figure]
view = "side"
goals_m = [["position_m", 0, 0]]
[[figure.links]]
name = "cart"
position_m = ["position_m", 0, 0.1]
[[figure.links]]
name = "pole"
parent = "cart"
axis = [0, 2, 0]
turn_rad = "0.5 - 2 * angle_rad*1.5+cart_mass_kg"
joined = true
lines_m = [[[0, 0, 0], [0, 0, "2*half_length_m"]]]
circles = [{ radius_m = "-half_length_m" }]
)";
  EXPECT_FALSE(nlohmann::json::parse(run_facts_json(*robot_of(test::kGoodRobot), RunResult{}, {})).contains("figure"));
  const auto robot = robot_of(test::kGoodRobot + figure);
  ASSERT_NE(robot, nullptr);
  const std::vector<double> truth = {1.1, 0.07, NAN, 0.2, 0.01};
  const auto json = nlohmann::ordered_json::parse(run_facts_json(*robot, RunResult{}, {"", "", true, truth}))["figure"];
  EXPECT_EQ(json["view"], "side");
  EXPECT_EQ(json["goals_m"].dump(), R"([[[[1.0,"position_m"]],[],[]]])");
  const auto& cart = json["links"][0];
  const auto& pole = json["links"][1];
  EXPECT_EQ(cart["parent"], -1);
  EXPECT_EQ(cart["position_m"].dump(), R"([[[1.0,"position_m"]],[],[[0.1,""]]])");
  EXPECT_EQ(pole["parent"], 0);
  EXPECT_EQ(pole["axis"].dump(), "[0.0,1.0,0.0]");
  EXPECT_EQ(pole["turn_rad"].dump(), R"([[0.5,""],[-3.0,"angle_rad"],[1.0,"cart_mass_kg"]])");
  EXPECT_EQ(pole["lines_m"].dump(), R"([[[[],[],[]],[[],[],[[2.0,"half_length_m"]]]]])");
  EXPECT_EQ(pole["circles"][0]["radius_m"].dump(), R"([[-1.0,"half_length_m"]])");
  EXPECT_FALSE(pole.contains("quaternion"));
  // fixed ones have no column in the log; of the plant what is known
  EXPECT_EQ(json["parameters"].dump(), R"({"cart_mass_kg":1.0,"force_N.time_constant_s":0.01})");
  EXPECT_EQ(json["true_parameters"].dump(),
            R"({"cart_mass_kg":1.1,"pole_mass_kg":0.07,"cart.damping_SI":0.2,"force_N.time_constant_s":0.01})");
}

TEST(RunFacts, EveryColumnThatTheyPromiseIsInTheLog) {
  const auto robot = robot_of(test::kGoodRobot);
  const auto columns = nlohmann::json::parse(run_facts_json(*robot, RunResult{}, {}))["columns"];
  const Words header = columns_of(*robot);
  const auto expect = [&](const std::string& column) { EXPECT_GE(index_of(header, column), 0) << column; };
  for (const std::string& input : keys_of(columns["inputs"])) expect(input);
  for (const auto& measured : columns["measured"])
    for (const char* prefix : {"", "innovation."}) expect(prefix + measured.get<std::string>());
  for (const std::string& state : keys_of(columns["states"]))
    for (const char* prefix : {"mean.", "sd.", "true."}) expect(prefix + state);
  EXPECT_EQ(columns["tracked"].dump(), "[]");
  for (const std::string& parameter : keys_of(columns["parameters"]))
    for (const char* prefix : {"mean.", "sd.", "q05.", "q95.", "true."}) expect(prefix + parameter);
}

TEST(RunFacts, ForcesAtJointsAndAtFramesAreInTheLogAndOnThePage) {
  const std::string arm = R"([model]
name = "acrobot"
period_s = 0.02
[parameters]
upper_mass_kg = { uniform = [0.5, 1.5] }
lower_mass_kg = 1.0
upper_length_m = 0.5
lower_length_m = 0.5
upper_com_m = 0.25
lower_com_m = 0.25
upper_inertia_kgm2 = 0.02
lower_inertia_kgm2 = 0.02
[measurement]
shoulder_rad = { sd = 0.002 }
elbow_rad = { sd = 0.002 }
[posterior]
disturbance = true
[cost]
state_weight = { shoulder_rad = 1.0 }
[limits]
elbow_Nm = { low = -5, high = 5 }
)";
  const auto robot = robot_of(arm);
  ASSERT_NE(robot, nullptr);
  const auto forces = nlohmann::ordered_json::parse(run_facts_json(*robot, RunResult{}, {}))["columns"]["forces"];
  EXPECT_EQ(forces.dump(), R"({"shoulder_Nm":"N m","elbow_Nm":"N m","tip_x_N":"N","tip_z_N":"N"})");
  const Words header = columns_of(*robot);
  EXPECT_GE(index_of(header, "touched"), 0);
  for (const auto& force : forces.items())
    for (const char* prefix : {"force.mean.", "force.sd."}) EXPECT_GE(index_of(header, prefix + force.key()), 0);
}

TEST(RunFacts, PriorsAreTheirOwnQuantiles) {
  const auto robot = robot_of(test::kGoodRobot);
  const auto priors = nlohmann::json::parse(run_facts_json(*robot, RunResult{}, {}))["priors"];
  EXPECT_NEAR(priors["pole_mass_kg"][0], 0.055, 1e-9);
  EXPECT_NEAR(priors["pole_mass_kg"][1], 0.145, 1e-9);
  // a normal prior of 0.5 +- 0.1 cut three deviations below: the cut takes 1.3e-3 of it
  EXPECT_NEAR(priors["half_length_m"][0], 0.5 - 0.1 * 1.6325, 1e-4);
  EXPECT_NEAR(priors["cart.damping_SI"][1], 0.2 * 2.276, 1e-3);
}

/// Three rows for cart_pole: the position is 10 times the row's number.
const std::vector<double> kReference = {0, 1, 0, 0, 10, 1, 0, 0, 20, 1, 0, 0};

std::unique_ptr<RobotFile> robot_with_reference() {
  auto robot = robot_of(test::kGoodRobot);
  robot->config.cost.reference = kReference.data();
  robot->config.cost.reference_steps = 3;
  return robot;
}

TEST(RunFacts, OfAReferenceTheyNameTheStatesThatFollowIt) {
  const auto robot = robot_with_reference();
  const auto facts = nlohmann::json::parse(run_facts_json(*robot, RunResult{}, {}));
  EXPECT_EQ(facts["columns"]["tracked"].dump(), R"(["angle_rad"])") << "what has no weight follows nothing";
  EXPECT_FALSE(facts.contains("target")) << "it moves";
}

TEST(RunFacts, APlaneIsTheTwoStatesInMetres) {
  std::string errors;
  const auto robot = read_robot_file(TILLER_TEST_ROBOTS "/planar_quadrotor.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const auto plane = [&] { return nlohmann::json::parse(run_facts_json(*robot, RunResult{}, {}))["plane"].dump(); };
  EXPECT_EQ(plane(), R"({"obstacles":[],"x":"x_m","y":"z_m"})");
  robot->config.cost.term_count = 1;
  robot->config.terms[0] = {tiller_cost_term_obstacles, {1, 0}, 0, 10, {0.5, 0.25, 0.2}};  // of z and x
  EXPECT_EQ(plane(), R"({"obstacles":[[0.5,0.25,0.2]],"x":"z_m","y":"x_m"})");
  EXPECT_FALSE(nlohmann::json::parse(run_facts_json(*robot_of(test::kGoodRobot), RunResult{}, {})).contains("plane"))
      << "a rail is none";
  const auto box = read_robot_file(TILLER_TEST_ROBOTS "/pusher_slider.toml", errors);
  ASSERT_NE(box, nullptr) << errors;
  EXPECT_EQ(nlohmann::json::parse(run_facts_json(*box, RunResult{}, {}))["plane"].dump(),
            R"({"obstacles":[],"x":"x_m","y":"y_m"})")
      << "of four states in metres those of the names";
}

TEST(TaskClock, CountsFromTheFirstTickInMotionAndAnewAfterAPause) {
  TaskClock clock;
  EXPECT_EQ(clock.step(0, tiller_state_standby), std::nullopt);
  EXPECT_EQ(clock.step(1, tiller_state_active), 0u);
  EXPECT_EQ(clock.step(2, tiller_state_hold), 1u) << "HOLD is a part of the task";
  EXPECT_EQ(clock.step(5, tiller_state_active), 4u) << "ticks that the log lost count";
  EXPECT_EQ(clock.step(6, tiller_state_safe), std::nullopt);
  EXPECT_EQ(clock.step(7, tiller_state_standby), std::nullopt);
  EXPECT_EQ(clock.step(8, tiller_state_active), 0u);
}

TEST(RunLog, HasTheReferencesRowThatIsDue) {
  const auto robot = robot_with_reference();
  const std::string path = testing::TempDir() + "/tiller_reference.csv";
  RunLog log(*robot, false, {});
  log.open(path);
  LoggedTick tick;
  const tiller_state_t states[] = {tiller_state_standby, tiller_state_active, tiller_state_active, tiller_state_active,
                                   tiller_state_active};
  for (const tiller_state_t state : states) {
    ++tick.info.ticks;
    tick.info.state = state;
    log.add(tick);
  }
  ASSERT_TRUE(log.close());
  std::istringstream lines(test::read_all(path));
  std::string line;
  std::getline(lines, line);
  const Words header = cells_of(line);
  const int column = index_of(header, "ref.position_m");
  ASSERT_GE(column, 0) << line;
  for (const char* expected : {"", "0", "10", "20", "20"}) {
    std::getline(lines, line);
    EXPECT_EQ(cells_of(line)[static_cast<std::size_t>(column)], expected);
  }
}

TEST(Units, AreWhatAFieldsNameEndsIn) {
  const char* const fields[][2] = {{"angle_rad", "rad"},
                                   {"velocity_m_s", "m/s"},
                                   {"tilt_rad_s", "rad/s"},
                                   {"x_m", "m"},
                                   {"x_m_s", "m/s"},
                                   {"force_N", "N"},
                                   {"damping_Nms", "N m s"},
                                   {"drag_Ns_m", "N s/m"},
                                   {"inertia_kgm2", "kg m^2"},
                                   {"half_length_m", "m"},
                                   {"lower_com_m", "m"},
                                   {"rate_m_s2", "m/s^2"},
                                   {"torque_gain", ""},
                                   {"coefficient", ""},
                                   {"s", ""},
                                   {"upper_mass_kg", "kg"},
                                   {"dead_zone_Nm", "N m"},
                                   {"mu_max_1_h", "1/h"},
                                   {"feed_L_h", "L/h"},
                                   {"sugar_g_L", "g/L"},
                                   {"uptake_g_L_h", "g/L/h"},
                                   {"speed_m_h", "m/h"},
                                   {"com_h", ""},    // a height
                                   {"wheel_L", ""},  // the left one
                                   {"joint_1_m", "m"},
                                   {"lag_1_s", "s"},
                                   {"wheel_L_rad_s", "rad/s"}};
  for (const auto& [name, unit] : fields) EXPECT_EQ(unit_of_field(name), unit) << name;
}

TEST(Units, OfAnEffectGoByItsPort) {
  const tiller_model_t& model = *tiller_find_model("cart_pole");
  const auto unit = [&](const char* kind, std::uint32_t port) {
    return unit_of_effect(effect_info(static_cast<std::uint32_t>(find_effect(kind))), 0, port, model);
  };
  EXPECT_EQ(unit("viscous_friction", 0), "N s/m");
  EXPECT_EQ(unit("viscous_friction", 1), "N m s/rad");
  EXPECT_EQ(unit("actuator_gain", 0), "1");
  EXPECT_EQ(unit("sensor_bias", 1), "rad") << "in the unit of the state that is measured";
}

}  // namespace
}  // namespace tiller::tools
