// Networks and policies as files: what is written is read back, what is wrong is named, and whose robot it is, too.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/open/robot_open.hpp"
#include "tools/robot/export_networks.hpp"
#include "tools/robot/network_file.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string pendulum_text() {
  std::ifstream file(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml", std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

StoredPolicy pendulum_policy() {
  StoredPolicy p;
  p.reads = tiller_policy_state | tiller_policy_belief_mean;
  p.squash = tiller_policy_sine;
  p.network.inputs = {"sin angle_rad", "cos angle_rad", "rate_rad_s", "mean mass_kg", "mean damping_Nms"};
  p.network.outputs = {"torque_Nm"};
  p.network.hidden[0] = 2;
  for (int i = 0; i < 15; ++i) p.network.weights.push_back(0.1f * static_cast<float>(i) - 0.7f);  // 2 (1 + 5) + 1 + 2
  p.low = {-1, -1, -8, 0.25f, 0};
  p.high = {1, 1, 8, 0.75f, 0.1f};
  return p;
}

/// A folder with a robot file and whatever else is put there; it goes with the test.
class Folder : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = fs::temp_directory_path() / ("tiller_network_file_" + std::to_string(getpid()));
    fs::create_directories(path_);
  }
  void TearDown() override { fs::remove_all(path_); }
  std::unique_ptr<RobotFile> robot(const std::string& more, std::string& errors) const {
    std::string text = pendulum_text();
    const std::string planner = "kind = \"cem\"";
    text.replace(text.find(planner), planner.size(), "kind = \"policy\"\nfallback = \"ilqr\"");
    return parse_robot_file(text + more, (path_ / "robot.toml").string(), errors);
  }
  void put(const std::string& name, const std::string& text) const { std::ofstream(path_ / name) << text; }
  fs::path path_;
};

TEST(NetworkFile, IsReadAsItWasWritten) {
  StoredPolicy back;
  std::string error;
  const StoredPolicy policy = pendulum_policy();
  ASSERT_TRUE(parse_policy(policy_text(policy), back, error)) << error;
  EXPECT_EQ(back.network.weights, policy.network.weights);  // to the last bit
  EXPECT_EQ(back.network.inputs, policy.network.inputs);
  EXPECT_EQ(back.reads, policy.reads);
  EXPECT_EQ(back.squash, policy.squash);
  EXPECT_EQ(back.high, policy.high);
  StoredNetwork network = policy.network, network_back;
  network.kind = tiller_network_gaussian;
  network.hidden[0] = 1;
  network.hidden[1] = 1;
  network.weights.assign(5 + 5 + 6 + 3, 0.25f);  // widths, a centre, a wave, an output
  ASSERT_TRUE(parse_network(network_text(network), network_back, error)) << error;
  EXPECT_EQ(network_back.kind, tiller_network_gaussian);
  EXPECT_EQ(network_back.weights, network.weights);
}

TEST(NetworkFile, NamesWhatIsWrong) {
  const json good = json::parse(policy_text(pendulum_policy()));
  const struct {
    const char* key;
    std::function<void(json&)> spoil;
  } cases[] = {{"format", [](json& j) { j["format"] = "tiller network"; }},
               {"version", [](json& j) { j["version"] = 2; }},
               {"squash", [](json& j) { j["squash"] = "tanh"; }},
               {"squash", [](json& j) { j.erase("squash"); }},
               {"reads", [](json& j) { j["reads"][0] = "future"; }},
               {"reads", [](json& j) { j["reads"] = 3; }},
               {"input_low", [](json& j) { j["input_low"].erase(0); }},
               {"input_high", [](json& j) { j["input_high"][0] = nullptr; }},
               {"network", [](json& j) { j["network"] = 1; }},
               {"network.kind", [](json& j) { j["network"]["kind"] = "relu"; }},
               {"network.inputs", [](json& j) { j["network"]["inputs"][0] = 7; }},
               {"network.members", [](json& j) { j["network"]["members"] = 17; }},
               {"network.members", [](json& j) { j["network"]["members"] = -1; }},
               {"network.hidden", [](json& j) { j["network"]["hidden"] = {2}; }},
               {"network.hidden",
                [](json& j) {
                  j["network"]["hidden"] = {65, 0};
                }},
               {"network.weights", [](json& j) { j["network"]["weights"][3] = "0"; }},
               {"network.weights", [](json& j) { j["network"]["weights"][3] = 2e9; }},
               {"network.weight_count", [](json& j) { j["network"]["weights"].erase(0); }}};
  for (const auto& one : cases) {
    json bad = good;
    one.spoil(bad);
    StoredPolicy out;
    std::string error;
    EXPECT_FALSE(parse_policy(bad.dump(), out, error)) << one.key;
    EXPECT_EQ(error.rfind(std::string(one.key) + ":", 0), 0u) << one.key << ": " << error;
    EXPECT_NE(error.find("; "), std::string::npos) << "no remedy: " << error;
  }
  StoredPolicy out;
  std::string error;
  for (const char* text : {"", "[", "[]", "3", "{}", "{\"format\": 1}"})
    EXPECT_FALSE(parse_policy(text, out, error)) << text;
}

/// A file that is cut anywhere is refused, and nothing else happens.
TEST(NetworkFile, IsRefusedWhereItIsCut) {
  const std::string text = policy_text(pendulum_policy());
  for (std::size_t length = 0; length + 2 < text.size(); ++length) {
    StoredPolicy out;
    std::string error;
    ASSERT_FALSE(parse_policy(text.substr(0, length), out, error)) << length;
  }
}

TEST_F(Folder, APolicyBelongsToItsRobot) {
  put("p.json", policy_text(pendulum_policy()));
  std::string errors;
  const auto robot = this->robot("\n[policy]\nfile = \"p.json\"\n", errors);
  ASSERT_TRUE(robot) << errors;
  ASSERT_TRUE(robot->config.policy);
  EXPECT_EQ(robot->config.planner.kind, std::uint32_t{tiller_planner_policy});
  EXPECT_EQ(robot->config.planner.fallback, std::uint32_t{tiller_planner_ilqr});
  EXPECT_EQ(robot->config.policy->network->weight_count, 15u);
  const RobotFile copy = *robot;
  EXPECT_EQ(copy.config.policy, robot->config.policy) << "copies share what was loaded";

  StoredPolicy other = pendulum_policy();
  other.network.inputs[3] = "mean length_m";
  put("p.json", policy_text(other));
  EXPECT_FALSE(this->robot("\n[policy]\nfile = \"p.json\"\n", errors));
  EXPECT_NE(errors.find("mean length_m"), std::string::npos) << errors;
  EXPECT_NE(errors.find("mean mass_kg"), std::string::npos) << errors;
}

TEST_F(Folder, WhatIsMissingIsToldWithItsPlace) {
  std::string errors;
  EXPECT_FALSE(robot("\n[policy]\nfile = \"none.json\"\n", errors));
  EXPECT_NE(errors.find("none.json"), std::string::npos) << errors;
  errors.clear();
  EXPECT_FALSE(robot("\n[policy]\n", errors));
  EXPECT_NE(errors.find("file"), std::string::npos) << errors;
  errors.clear();
  EXPECT_FALSE(robot("", errors)) << "a planner that has nothing to evaluate";
  EXPECT_NE(errors.find("policy"), std::string::npos) << errors;
}

TEST_F(Folder, ExportsConstantArrays) {
  put("p.json", policy_text(pendulum_policy()));
  std::string errors;
  auto robot = this->robot("\n[policy]\nfile = \"p.json\"\n", errors);
  ASSERT_TRUE(robot) << errors;
  const std::string text = networks_text(*robot, "arm");
  EXPECT_NE(text.find("static const float arm_policy_network_weights[15]"), std::string::npos) << text;
  EXPECT_NE(text.find("static const tiller_policy_t arm_policy"), std::string::npos) << text;
  robot->config.planner.kind = tiller_planner_ilqr;
  EXPECT_EQ(networks_text(*robot, "arm"), "") << "nobody reads it";
}

}  // namespace
}  // namespace tiller::tools
