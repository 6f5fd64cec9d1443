// Right robot files: every value arrives where it belongs, and the documentation tells the truth.
#include "tools/robot/robot_file.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

#include "effects/effect_info.hpp"
#include "robot_text.hpp"
#include "sim/devices/drive_axis.hpp"
#include "tools/links/link.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/drive_settings.hpp"
#include "tools/robot/effects_text.hpp"
#include "tools/robot/limits_text.hpp"
#include "tools/robot/robot_help.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

std::unique_ptr<RobotFile> good() {
  std::string errors;
  auto robot = parse_robot_file(test::kGoodRobot, "bench.toml", errors);
  EXPECT_NE(robot, nullptr) << errors;
  return robot;
}

TEST(RobotFile, NamesAndModel) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  EXPECT_EQ(robot->name, "bench");
  EXPECT_EQ(robot->config.seed, 7u);
  EXPECT_EQ(robot->config.model, tiller_find_model("cart_pole"));
  EXPECT_EQ(join(robot->names.params),
            "cart_mass_kg, pole_mass_kg, half_length_m, cart.damping_SI, force_N.time_constant_s");
  EXPECT_EQ(join(robot->names.measurements), "position_m, angle_rad");
  EXPECT_EQ(robot->config.substeps, 2u);
  EXPECT_EQ(robot->config.integrator, static_cast<std::uint32_t>(tiller_integrator_midpoint));
}

TEST(RobotFile, PriorsAndEffects) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  const tiller_config_t& c = robot->config;
  ASSERT_EQ(c.param_count, 5u);
  const tiller_prior_t expected[] = {{tiller_prior_fixed, 0, 1.0, 0, 1.0, 1.0},
                                     {tiller_prior_uniform, 0, 0.05, 0.15, 0.05, 0.15},
                                     {tiller_prior_normal, 0, 0.5, 0.1, 0.2, INFINITY},
                                     {tiller_prior_log_normal, 0, 0.2, 0.5, 0.0, 2.0},
                                     {tiller_prior_fixed, 0, 0.01, 0, 0.01, 0.01}};
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(c.priors[i].kind, expected[i].kind) << i;
    EXPECT_EQ(c.priors[i].a, expected[i].a) << i;
    EXPECT_EQ(c.priors[i].low, expected[i].low) << i;
    EXPECT_EQ(c.priors[i].high, expected[i].high) << i;
    if (expected[i].kind != tiller_prior_fixed && expected[i].kind != tiller_prior_uniform) {
      EXPECT_EQ(c.priors[i].b, expected[i].b) << i;
    }
  }
  ASSERT_EQ(c.effect_count, 2u);
  EXPECT_EQ(c.effects[0].kind, static_cast<std::uint32_t>(tiller_effect_viscous_friction));
  EXPECT_EQ(c.effects[0].port, 0u);
  EXPECT_EQ(c.effects[1].kind, static_cast<std::uint32_t>(tiller_effect_actuator_lag));
}

// "all" where the model has two ports and more of the kind.
TEST(RobotFile, AnEffectMayStandAtAllPorts) {
  std::string text = test::kGoodRobot, errors;
  const std::string one = "port = \"cart\"\ndamping_SI";
  text.replace(text.find(one), one.size(), "port = \"all\"\ndamping_SI");
  const auto robot = parse_robot_file(text, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  EXPECT_EQ(robot->config.effects[0].port, TILLER_EVERY_PORT);
  EXPECT_EQ(robot->names.params[robot->config.model->param_count], "all.damping_SI");
  const std::string input = "port = \"force_N\"";
  text.replace(text.find(input), input.size(), "port = \"all\"");
  EXPECT_EQ(parse_robot_file(text, "bench.toml", errors), nullptr);
  EXPECT_NE(errors.find("known: force_N"), std::string::npos) << errors;
}

// The body has one port, which needs no name; tails beyond what physics allows are cut.
TEST(RobotFile, EffectsOfTheBodyAndOfSensors) {
  std::string text = test::kGoodRobot, errors;
  const std::string before = "[[effects]]\nkind = \"actuator_lag\"";
  text.replace(text.find(before), 0,
               "[[effects]]\nkind = \"tilt\"\nangle_rad = { normal = [0.0, 0.03] }\n"
               "[[effects]]\nkind = \"sensor_bias\"\nport = \"angle_rad\"\nbias_SI = { uniform = [-0.1, 0.1] }\n");
  const auto robot = parse_robot_file(text, "bench.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const tiller_config_t& c = robot->config;
  ASSERT_EQ(c.effect_count, 4u);
  EXPECT_EQ(c.effects[1].port, 0u);
  EXPECT_EQ(c.effects[2].port, 1u);
  EXPECT_EQ(robot->names.params[4], "body.angle_rad");
  EXPECT_EQ(robot->names.params[5], "angle_rad.bias_SI");
  EXPECT_EQ(c.priors[4].low, effect_info(tiller_effect_tilt).params[0].low);
  EXPECT_EQ(c.priors[4].high, effect_info(tiller_effect_tilt).params[0].high);
  // engines that take the measurement for the state refuse, and say so
  text.replace(text.find("[posterior]\n"), 12, "[posterior]\nkind = \"transition\"\n");
  EXPECT_EQ(parse_robot_file(text, "bench.toml", errors), nullptr);
  EXPECT_NE(errors.find("no effect at a sensor"), std::string::npos) << errors;
}

TEST(RobotFile, SensorsLimitsAndPlanner) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  const tiller_config_t& c = robot->config;
  EXPECT_EQ(c.measurement_count, 2u);
  EXPECT_EQ(c.measured_state[1], 1u);
  EXPECT_EQ(c.measurement_sd[0], 0.001);
  EXPECT_EQ(c.safety.measurement_low[0], -2);
  EXPECT_EQ(c.safety.measurement_rate_per_s[0], 20);
  EXPECT_EQ(c.safety.measurement_high[1], INFINITY);
  EXPECT_EQ(c.safety.input_low[0], -20);
  EXPECT_EQ(c.safety.input_high[0], 18);
  EXPECT_EQ(c.safety.input_rate_per_s[0], 400);
  EXPECT_EQ(c.safety.safe_command[0], 1);
  EXPECT_EQ(c.safety.hold_gain[2], 4);
  EXPECT_EQ(c.planner.kind, static_cast<std::uint32_t>(tiller_planner_cem));
  EXPECT_EQ(c.planner.risk, static_cast<std::uint32_t>(tiller_risk_cvar));
  EXPECT_EQ(c.planner.noise_sd[0], 8);
  EXPECT_EQ(c.cost.terminal_weight[1], 100);
  EXPECT_EQ(c.initial_state[1], 3.14);
  EXPECT_EQ(c.record_ticks, 100u);
}

TEST(RobotFile, HostSections) {
  const auto robot = good();
  ASSERT_NE(robot, nullptr);
  EXPECT_EQ(robot->transport.kind, "socketcan");
  EXPECT_EQ(robot->transport.interface, "can7");
  ASSERT_EQ(robot->transport.drives.size(), 1u);
  EXPECT_EQ(robot->transport.drives[0].actuator, "odrive");
  EXPECT_EQ(robot->transport.drives[0].command, "torque");
  EXPECT_EQ(robot->transport.nodes, std::vector<std::uint32_t>{3});
  EXPECT_EQ(robot->transport.wheel_radius_m, std::vector<double>{0.05});
  EXPECT_EQ(join(robot->transport.channels), "position:force_N, board:0");
  EXPECT_TRUE(robot->realtime.by_clock);
  EXPECT_EQ(robot->realtime.priority, 55);
  EXPECT_EQ(robot->realtime.cpus, 10u);
  EXPECT_TRUE(robot->realtime.lock_memory);
  EXPECT_GT(robot->realtime.line, 0);
  EXPECT_EQ(robot->sim.sensor_step.at("position_m"), 0.0002);
  EXPECT_EQ(robot->sim.watchdog_s, 0.2);
  EXPECT_EQ(robot->sim.plan_timeout_s, 0.5);
  ASSERT_EQ(robot->sim.effects.size(), 1u);
  EXPECT_EQ(robot->sim.effects[0].parameters.at("coefficient"), 0.1);
  EXPECT_EQ(robot->log.units.at("angle_rad"), "deg");
}

TEST(RobotFileDrives, WhatEachDriveNeedsToBeTold) {
  std::string errors;
  const auto robot = parse_robot_file(
      test::with("nodes = { force_N = 3 }",
                 "nodes = { force_N = 7 }\nactuator = { force_N = \"mit\" }\n"
                 "drives.force_N = { command = \"position\", reply = \"damiao\", reply_id = 5, kp_Nm_rad = 20, "
                 "position_rad = 500 }"),
      "robot.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  const DriveSection& drive = robot->transport.drives[0];
  EXPECT_EQ(drive.actuator, "mit");
  EXPECT_EQ(drive.command, "position");
  EXPECT_EQ(drive.reply, "damiao");
  EXPECT_EQ(drive.reply_id, 5u);
  EXPECT_EQ(drive.kp_Nm_rad, 20);
  EXPECT_EQ(drive.torque_Nm, 18) << "the default";
}

// A word that a list elsewhere lacked became number -1 of an enumeration.
TEST(RobotFileDrives, AnUnknownWordIsRefusedWithTheKnownOnes) {
  struct Case {
    std::string DriveSection::*word;
    const char* known;
  };
  for (const Case& c : {Case{&DriveSection::actuator, "write one of: odrive, moteus, mit"},
                        Case{&DriveSection::command, "write one of: torque, velocity, position"},
                        Case{&DriveSection::resolution, "write one of: int8, int16, int32, f32"},
                        Case{&DriveSection::reply, "write one of: plain, ak, damiao"}}) {
    DriveSection drive;
    drive.*c.word = "vesc";
    ActuatorSettings settings;
    std::string error;
    EXPECT_FALSE(drive_settings(drive, 3, settings, error));
    EXPECT_NE(error.find("'vesc'"), std::string::npos) << error;
    EXPECT_NE(error.find(c.known), std::string::npos) << error;
    EXPECT_LT(settings.kind, ActuatorKind::count);
  }
  auto robot = good();
  robot->transport.drives[0].actuator = "vesc";
  TransportLinkOptions options;
  options.kind = robot->transport.kind;
  std::string error;
  EXPECT_EQ(make_transport_link(*robot, options, error), nullptr);
  EXPECT_NE(error.find("transport.drives.force_N: 'vesc' is no actuator; write one of: odrive"), std::string::npos)
      << error;
}

// Every protocol of actuators.def is a word of the file, of its help, and of the emulated drives.
TEST(RobotFileDrives, EveryProtocolIsReadAndEmulated) {
  const std::string manual = robot_file_markdown();
  for (const std::string& word : actuator_words()) {
    std::string errors;
    const auto robot =
        parse_robot_file(test::with("nodes = { force_N = 3 }", "nodes = { force_N = 3 }\nactuator = \"" + word + "\""),
                         "robot.toml", errors);
    ASSERT_NE(robot, nullptr) << errors;
    ActuatorSettings settings;
    ASSERT_TRUE(drive_settings(robot->transport.drives[0], robot->transport.nodes[0], settings, errors)) << errors;
    EXPECT_EQ(actuator_name(settings.kind).word, word);
    EXPECT_EQ(settings.node, 3u);
    EXPECT_NE(manual.find(word), std::string::npos);
    sim::DriveOptions drive;
    drive.protocol = word;
    EXPECT_NE(sim::make_drive(drive, errors), nullptr) << errors;
  }
}

// Sensors are delivered in the order of the file, not in that of their names.
TEST(RobotFile, ThePlantHasRateSensorsWhereItIsAskedForThem) {
  const std::string model = R"([robot]
name = "rates"
[model]
name = "pendulum"
[parameters]
mass_kg = 0.5
length_m = 0.5
damping_Nms = 0
[measurement]
rate_rad_s = { sd = 0.01 }
angle_rad = { sd = 0.001 }
[posterior]
kind = "transition"
[limits]
torque_Nm = { low = -1, high = 1 }
[sim]
)";
  std::string errors;
  const auto without = parse_robot_file(model, "rates.toml", errors);
  ASSERT_NE(without, nullptr) << errors;
  EXPECT_EQ(make_sim_plant(*without, errors), nullptr);
  EXPECT_NE(errors.find("rate_rad_s"), std::string::npos) << errors;
  errors.clear();
  const auto with = parse_robot_file(model + "rates = true\n", "rates.toml", errors);
  ASSERT_NE(with, nullptr) << errors;
  const auto plant = make_sim_plant(*with, errors);
  ASSERT_NE(plant, nullptr) << errors;
  EXPECT_EQ(plant->measured_from, (std::vector<std::size_t>{1, 0}));
}

TEST(RobotFile, MeasurementsKeepTheOrderOfTheFile) {
  std::string text =
      test::with("position_m = { sd = 0.001, low", "rate_rad_s = { sd = 0.1 }\nposition_m = { sd = 0.001, low");
  const std::string channels = "channels = { ";
  text.insert(text.find(channels) + channels.size(), "rate_rad_s = \"velocity:force_N\", ");
  std::string errors;
  const auto robot = parse_robot_file(text, "r.toml", errors);
  ASSERT_NE(robot, nullptr) << errors;
  EXPECT_EQ(join(robot->names.measurements), "rate_rad_s, position_m, angle_rad");
  EXPECT_EQ(robot->config.measured_state[0], 3u);
}

TEST(RobotFile, ShippedFilesAreValid) {
  for (const char* name :
       {"cart_pole.toml", "pendulum.toml", "acrobot.toml", "planar_quadrotor.toml", "furuta.toml", "hopper.toml"}) {
    std::string errors;
    const auto robot = read_robot_file(std::string(TILLER_TEST_ROBOTS) + "/" + name, errors);
    ASSERT_NE(robot, nullptr) << errors;
    EXPECT_GT(tiller_size(&robot->config), 0u) << name;
  }
}

TEST(RobotFile, TheQuickStartsFileIsValid) {
  std::ifstream file(TILLER_TEST_DOCS "/guide/quick_start.md");
  std::stringstream page;
  page << file.rdbuf();
  const std::string text = page.str();
  const std::size_t begin = text.find("```toml\n");
  ASSERT_NE(begin, std::string::npos);
  const std::size_t end = text.find("```", begin + 8);
  std::string errors;
  EXPECT_NE(parse_robot_file(text.substr(begin + 8, end - begin - 8), "quick_start.md", errors), nullptr) << errors;
}

// A key that the schema ties to a field must be read: each one alone, at its lower or upper end.
TEST(RobotFile, EveryBoundKeyReachesItsField) {
  int checked = 0;
  for (const KeySpec& key : robot_keys()) {
    if (key.offset < 0 || key.kind != KeyKind::count) continue;
    const std::string section = key.section;
    const std::string header = "[" + section + "]\n";
    std::string text = test::kGoodRobot;
    const std::string present = "\n" + std::string(key.key) + " = ";
    const std::size_t begin = text.find(header);
    ASSERT_NE(begin, std::string::npos) << header;
    const std::size_t end = text.find("\n[", begin + 1);
    const std::size_t old = text.find(present, begin);
    if (old != std::string::npos && old < end) {
      const std::size_t line_end = text.find('\n', old + 1);
      text.erase(old + 1, line_end - old);
    }
    const std::uint32_t value = std::string(key.key) == "moves_per_tick" ? 8 : static_cast<std::uint32_t>(key.low);
    text.insert(begin + header.size(), std::string(key.key) + " = " + std::to_string(value) + "\n");
    std::string errors;
    const auto robot = parse_robot_file(text, "r.toml", errors);
    if (!robot) {  // a lower end that another key forbids is an answer too, if it names the key
      EXPECT_NE(errors.find(key.key), std::string::npos) << errors;
      continue;
    }
    std::uint32_t stored;
    std::memcpy(&stored, reinterpret_cast<const char*>(&robot->config) + key.offset, sizeof stored);
    EXPECT_EQ(stored, value) << section << "." << key.key;
    ++checked;
  }
  EXPECT_GE(checked, 10);
}

// What a key says of its readers names planners, and `tiller planners` goes by it.
/// What a file leaves out is chosen for `mppi` alone, and not beside what it states.
TEST(RobotFile, MppiChoosesItsSamplesWhereTheFileDoesNot) {
  const std::string stated = "kind = \"cem\"\nhorizon = 40\nknots = 8\nrollouts = 64\nparticles = 4\niterations = 2\n";
  const auto planner_of = [&](const std::string& lines) {
    std::string text = test::kGoodRobot, errors;
    text.replace(text.find(stated), stated.size(), lines + "\nhorizon = 40\nparticles = 4\n");
    const auto robot = parse_robot_file(text, "bench.toml", errors);
    EXPECT_NE(robot, nullptr) << errors;
    return robot ? robot->config.planner : tiller_planner_config_t{};
  };
  const tiller_planner_config_t chosen = planner_of("kind = \"mppi\"");
  EXPECT_EQ(chosen.knots, 6u);
  EXPECT_EQ(chosen.rollouts, 128u);
  EXPECT_EQ(chosen.iterations, 4u);
  EXPECT_EQ(chosen.temperature, 0.02);
  const tiller_planner_config_t beside = planner_of("kind = \"mppi\"\ntemperature = 0.1");
  EXPECT_EQ(beside.rollouts, 256u);
  EXPECT_EQ(beside.iterations, 2u);
  EXPECT_EQ(planner_of("kind = \"cem\"").iterations, 2u);
}

TEST(RobotFile, PlannersReadTheirSettings) {
  const KeySpec& elite = *find_key("planner", "elite_fraction");
  EXPECT_TRUE(planner_reads(elite, "cem"));
  EXPECT_FALSE(planner_reads(elite, "mppi"));
  EXPECT_FALSE(planner_reads(elite, "ce"));
  EXPECT_TRUE(planner_reads(*find_key("planner", "horizon"), "mppi"));
  const Words known = {"random_shooting", "cem", "mppi", "ilqr", "sqp", "mcts", "hybrid", "policy"};
  for (const std::string& name : planner_names()) EXPECT_GE(index_of(known, name), 0) << name << " reads nothing";
  for (const KeySpec& key : robot_keys()) {
    std::string readers = key.readers ? std::string(key.readers) + ", " : "";
    for (std::size_t end; (end = readers.find(", ")) != std::string::npos; readers.erase(0, end + 2))
      EXPECT_GE(index_of(known, readers.substr(0, end)), 0) << key.key << ": " << readers;
  }
}

TEST(RobotFile, DocumentationOfEffectsIsTheCatalogue) {
  std::ifstream file(TILLER_TEST_DOCS "/reference/effects.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_NE(text.str().find(effects_markdown()), std::string::npos)
      << "docs/reference/effects.md is not what the catalogue says; paste the output of `tiller effects --markdown` "
         "below its heading \"Every effect\"";
}

TEST(RobotFile, DocumentationIsTheSchema) {
  std::ifstream file(TILLER_TEST_DOCS "/reference/robot_file.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_NE(text.str().find(robot_file_markdown()), std::string::npos)
      << "docs/reference/robot_file.md is not what the schema says; paste the output of `tiller help robot-file --markdown` "
         "below its heading \"Every key\"";
}

TEST(RobotFile, DocumentationOfLimitsIsTheHeaders) {
  const auto content = [](const std::string& path) {
    std::ifstream file(path);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
  };
  EXPECT_NE(content(TILLER_TEST_DOCS "/reference/limits.md").find(limits_markdown()), std::string::npos)
      << "docs/reference/limits.md is not what the headers say; paste the output of `tiller help limits --markdown` below its "
         "heading \"Every limit\"";
  // none is left out: each constant of the public headers is in the table
  int constants = 0;
  for (const char* header : {"model.h", "model.hpp", "tiller.h"}) {
    std::istringstream lines(content(std::string(TILLER_TEST_INCLUDE "/tiller/") + header));
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("#define TILLER_MAX_", 0) != 0) continue;
      const std::string name = line.substr(8, line.find(' ', 8) - 8);
      EXPECT_NE(limits_markdown().find("`" + name + "`"), std::string::npos) << name << " of " << header;
      ++constants;
    }
  }
  EXPECT_GE(constants, 13);
}

}  // namespace
}  // namespace tiller::tools
