// Simulator files: what is read, and every error told in one go.

#include "tools/simulator/simulator_file.hpp"

#include <gtest/gtest.h>

namespace tiller::tools {
namespace {

const char* const kGood = R"([simulator]
command = ["python3", "puck.py"]
inputs = ["force_N"]
period_s = 0.02
timeout_s = 3
processes = 2
piece_s = 0.5

[parameters]
friction = { uniform = [0.1, 0.9] }
mass_kg = 0.5

[measurements]
position_m = { sd = 0.001 }
speed_m_s = { sd = 0 }

[log]
columns = { position_m = "x" }
)";

TEST(SimulatorFile, IsRead) {
  std::string errors;
  const auto file = parse_simulator_file(kGood, "some/puck.toml", errors);
  ASSERT_TRUE(file) << errors;
  EXPECT_EQ(file->setup.command, (Words{"python3", "puck.py"}));
  EXPECT_EQ(file->setup.folder, "some");
  EXPECT_EQ(file->setup.names.parameters, (Words{"friction", "mass_kg"}));
  EXPECT_EQ(file->setup.names.inputs, (Words{"force_N"}));
  EXPECT_EQ(file->setup.names.measurements, (Words{"position_m", "speed_m_s"}));
  EXPECT_EQ(file->setup.names.period_s, 0.02);
  EXPECT_EQ(file->setup.timeout_s, 3.0);
  EXPECT_EQ(file->setup.processes, 2u);
  EXPECT_EQ(file->piece_s, 0.5);
  EXPECT_EQ(file->robot.config.priors[0].kind, tiller_prior_uniform);
  EXPECT_EQ(file->robot.config.priors[1].kind, tiller_prior_fixed);
  EXPECT_EQ(file->robot.config.measurement_sd[0], 0.001);
  EXPECT_EQ(file->robot.log.columns.at("position_m"), "x");
  EXPECT_STREQ(file->robot.config.model->name, "puck");
  EXPECT_STREQ(file->robot.config.model->state_names[1], "speed_m_s");
}

TEST(SimulatorFile, TakesARobotFilesPriorsAndNames) {
  std::string errors;
  const auto file = parse_simulator_file("[simulator]\ncommand = [\"sim\"]\nrobot = \"pendulum.toml\"\n",
                                         std::string(TILLER_ROBOTS) + "/x.toml", errors);
  ASSERT_TRUE(file) << errors;
  EXPECT_STREQ(file->robot.config.model->name, "pendulum");
  EXPECT_EQ(file->setup.names.measurements, (Words{"angle_rad"}));
  EXPECT_EQ(file->setup.names.parameters, file->robot.names.params);
}

TEST(SimulatorFile, TellsEveryError) {
  const struct {
    const char *from, *to, *told;
  } cases[] = {
      {"command = [\"python3\", \"puck.py\"]", "", "simulator.command: missing"},
      {"command = [\"python3\", \"puck.py\"]", "command = \"puck\"", "is no list of texts"},
      {"timeout_s", "timeout", "unknown key"},
      {"period_s = 0.02", "", "simulator.period_s: missing"},
      {"processes = 2", "processes = 2.5", "is no whole number"},
      {"piece_s = 0.5", "piece_s = -1", "is no number in 0 .. "},
      {"[measurements]", "[measured]", "unknown section"},
      {"{ sd = 0.001 }", "{ noise = 0.001 }", "measurements.position_m"},
      {"{ uniform = [0.1, 0.9] }", "{ uniform = [0.9, 0.1] }", "the range is reversed"},
      {"{ uniform = [0.1, 0.9] }", "0.5", "are all known"},
      {"position_m = \"x\"", "position = \"x\"", "is no state or input"},
      {"piece_s = 0.5", "robot = \"other.toml\"", "the robot file has it"},
  };
  for (const auto& c : cases) {
    std::string text = kGood, errors;
    text.replace(text.find(c.from), std::string(c.from).size(), c.to);
    EXPECT_FALSE(parse_simulator_file(text, "puck.toml", errors)) << c.to;
    EXPECT_NE(errors.find(c.told), std::string::npos) << c.to << "\n" << errors;
    EXPECT_EQ(errors.rfind("puck.toml:", 0), 0u) << errors;
  }
}

TEST(SimulatorFile, TellsSyntaxAndAbsence) {
  std::string errors;
  EXPECT_FALSE(parse_simulator_file("[simulator\n", "a.toml", errors));
  EXPECT_NE(errors.find("a.toml:1"), std::string::npos) << errors;
  EXPECT_FALSE(parse_simulator_file("", "a.toml", errors));
  EXPECT_NE(errors.find("[simulator]"), std::string::npos) << errors;
  EXPECT_FALSE(read_simulator_file("/no/such.toml", errors));
  EXPECT_NE(errors.find("/no/such.toml: cannot be read"), std::string::npos) << errors;
}

}  // namespace
}  // namespace tiller::tools
