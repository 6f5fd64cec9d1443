// Robot files whose model has no finite motion, and files that say what nobody means.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/robot/robot_hints.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

std::string read(const std::string& path) {
  std::ifstream file(path);
  EXPECT_TRUE(file) << path;
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string changed(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

void expect_said(const std::string& text, const std::string& word) {
  EXPECT_NE(text.find(word), std::string::npos) << "lacks '" << word << "': " << text;
}

class OwnModel : public testing::Test {
 protected:
  static void SetUpTestSuite() { setenv("TILLER_CACHE", (fs::path(testing::TempDir()) / "own_model").c_str(), 1); }

  std::string reactor(const std::string& from = "", const std::string& to = "") const {
    const std::string text = read(TILLER_TEST_REACTOR);
    return from.empty() ? text : changed(text, from, to);
  }
  RobotText parse(const std::string& text, const std::string& path = TILLER_TEST_REACTOR) {
    errors_.clear();
    RobotText read = parse_robot_text(text, path, errors_);
    hints_ = read.robot ? robot_hints(*read.robot, text) : "";
    return read;
  }
  RobotText parse_shipped(const std::string& name, const std::string& from, const std::string& to) {
    const std::string path = std::string(TILLER_TEST_ROBOTS) + "/" + name;
    return parse(changed(read(path), from, to), path);
  }

  std::string errors_, hints_;
};

TEST_F(OwnModel, AStartWithoutMotionIsRefusedWithTheEquationsAndTheNumber) {
  EXPECT_EQ(parse(reactor()).robot, nullptr);
  expect_said(errors_, "robot.toml:6: start: the model has no finite motion there: the rate of biomass_g_L is nan, ");
  expect_said(errors_, "the rate of substrate_g_L is nan, the rate of product_g_L is nan, because of volume_L = 0; ");
  EXPECT_EQ(errors_.find("the rate of volume_L"), std::string::npos) << "it is finite: " << errors_;
  EXPECT_EQ(errors_.find("because of biomass_g_L"), std::string::npos) << errors_;
  expect_said(errors_, "[start] state");
}

TEST_F(OwnModel, AFiniteStartIsTakenAndPointsNearItAreProbed) {
  ASSERT_NE(parse(reactor("[posterior]", "[start]\nstate = { volume_L = 1 }\n\n[posterior]")).robot, nullptr)
      << errors_;
  EXPECT_EQ(hints_.find("no finite motion"), std::string::npos) << hints_;
  // x = -0.5 (1 +- sqrt(1 - 4 Ks / Ki)) Ki has no growth rate: a range that holds it, and a model that refuses it
  const std::string negative = "[start]\nstate = { volume_L = 1 }\nsd = { volume_L = 5 }\n\n[posterior]";
  ASSERT_NE(parse(reactor("[posterior]", negative)).robot, nullptr) << errors_;
  EXPECT_EQ(hints_.find("no finite motion"), std::string::npos) << "a pole is no area: " << hints_;
}

TEST_F(OwnModel, APartOfTheStartWithoutMotionIsAHint) {
  const fs::path folder = fs::path(testing::TempDir()) / "own_model_root";
  fs::create_directories(folder);
  std::ofstream(folder / "bioreactor.c") << changed(read(fs::path(TILLER_TEST_REACTOR).parent_path() / "bioreactor.c"),
                                                    "u[0] / x[volume]", "u[0] / sqrt(x[volume])")
                                         << "\n";
  std::string source = read((folder / "bioreactor.c").string());
  std::ofstream(folder / "bioreactor.c") << "#include <math.h>\n" << source;
  const std::string start = "[start]\nstate = { volume_L = 1 }\nsd = { volume_L = 1 }\n\n[posterior]";
  ASSERT_NE(parse(reactor("[posterior]", start), (folder / "robot.toml").string()).robot, nullptr) << errors_;
  expect_said(hints_, "the model has no finite motion at ");
  expect_said(hints_, " of 64 random points");
  expect_said(hints_, "the rate of biomass_g_L is nan");
  expect_said(hints_, "select(x > least");
}

TEST_F(OwnModel, UnitsThatAreNoneOfTillersAreTold) {
  ASSERT_NE(parse(reactor("[posterior]", "[start]\nstate = { volume_L = 1 }\n\n[posterior]")).robot, nullptr)
      << errors_;
  expect_said(hints_, "model.file = \"bioreactor.c\": feed_L_h, mu_max_1_h are in hours by name");
  expect_said(hints_, "convert in the equations and end the name with _s");
}

TEST_F(OwnModel, ABuiltInModelThatDividesByAParameterIsRefusedToo) {
  EXPECT_EQ(parse_shipped("pendulum.toml", "length_m = 0.5", "length_m = 0").robot, nullptr);
  expect_said(errors_, "the rate of rate_rad_s is nan, because of length_m = 0");
}

TEST_F(OwnModel, ShippedRobotsHaveNoHints) {
  int count = 0;
  for (const auto& entry : fs::directory_iterator(TILLER_TEST_ROBOTS)) {
    if (entry.path().extension() != ".toml") continue;
    if (!parse(read(entry.path().string()), entry.path().string()).robot) continue;  // models to be compiled
    EXPECT_EQ(hints_, "") << entry.path();
    ++count;
  }
  EXPECT_GT(count, 3);
}

TEST_F(OwnModel, MillisecondsAreTold) {
  EXPECT_EQ(parse_shipped("pendulum.toml", "period_s = 0.02", "period_s = 20").robot, nullptr);
  expect_said(errors_,
              "safety.sensor_timeout_s = 0.1: 0.1 s is below the control period of 20 s; if 20 ms is meant, "
              "write [model] period_s = 0.02");
  const std::string path = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  ASSERT_NE(
      parse(changed(changed(read(path), "period_s = 0.02", "period_s = 20"), "sensor_timeout_s = 0.1", ""), path).robot,
      nullptr)
      << errors_;
  expect_said(hints_,
              "model.period_s = 20: a control period of 20 s is long for a robot, and the model's fastest mode");
  expect_said(hints_, "if 20 ms is meant, write period_s = 0.02");
  ASSERT_NE(parse_shipped("pendulum.toml", "sensor_timeout_s = 0.1", "sensor_timeout_s = 100").robot, nullptr)
      << errors_;
  expect_said(hints_, "safety.sensor_timeout_s = 100: 100 s are 5000 control periods");
  expect_said(hints_, "if 100 ms is meant, write sensor_timeout_s = 0.1");
  // a second is short for a vessel whose fastest mode takes several
  std::string slow = reactor("period_s = 0.02", "period_s = 2");
  slow = changed(slow, "sensor_timeout_s = 0.1", "");
  slow = changed(slow, "[posterior]", "[start]\nstate = { volume_L = 1, substrate_g_L = 1 }\n\n[posterior]");
  ASSERT_NE(parse(slow).robot, nullptr) << errors_;
  EXPECT_EQ(hints_.find("model.period_s"), std::string::npos) << hints_;
  ASSERT_NE(parse(changed(slow, "period_s = 2", "period_s = 20")).robot, nullptr) << errors_;
  expect_said(hints_, "if 20 ms is meant, write period_s = 0.02");
}

TEST_F(OwnModel, DegreesAreTold) {
  const std::string upright = "angle_rad = 3.141592653589793";
  ASSERT_NE(parse_shipped("pendulum.toml", upright, "angle_rad = 180").robot, nullptr) << errors_;
  expect_said(hints_, "cost.target.angle_rad = 180: 180 rad are 28.6 turns; if degrees are meant, write 3.14159");
  ASSERT_NE(parse_shipped("pendulum.toml", upright, "angle_rad = -6.283").robot, nullptr) << errors_;
  EXPECT_EQ(hints_, "") << "a turn is a turn";
  ASSERT_NE(parse_shipped("pendulum.toml", upright, "rate_rad_s = 180").robot, nullptr) << errors_;
  EXPECT_EQ(hints_, "") << "a speed is no angle";
}

}  // namespace
}  // namespace tiller::tools
