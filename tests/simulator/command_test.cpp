// Black boxes by the command: control that alternates with a real simulator's posterior, and `tiller identify` with a
// black box in its model's place.

#include <cmath>
#include <nlohmann/json.hpp>

#include "command_rig.hpp"

namespace tiller::test {
namespace {

using nlohmann::json;

/// A pendulum whose mass alone is unknown, cheap to steer; the plant's is 0.65 kg.
const char* const kRobot = R"([robot]
name = "small"
[model]
name = "pendulum"
period_s = 0.02
[parameters]
mass_kg = { uniform = [0.25, 0.75] }
length_m = 0.5
damping_Nms = 0.05
[measurement]
angle_rad = { sd = 0.002 }
[noise]
process_sd = { rate_rad_s = 0.02 }
[start]
sd = { angle_rad = 0.01, rate_rad_s = 0.01 }
[planner]
kind = "cem"
horizon = 20
knots = 5
rollouts = 32
particles = 4
iterations = 1
noise_sd = { torque_Nm = 1.0 }
[cost]
target = { angle_rad = 3.141592653589793 }
state_weight = { angle_rad = 4.0 }
input_weight = { torque_Nm = 0.01 }
[limits]
torque_Nm = { low = -1.5, high = 1.5, safe = 0 }
[sim]
plant = "pendulum"
parameters = { mass_kg = 0.65, damping_Nms = 0.05 }
sensors.angle_rad = { sd = 0.002 }
seed = 1
)";

class SimulatorCommand : public Command {
 protected:
  void SetUp() override {
    Command::SetUp();
    write("robot.toml", kRobot);
    write("box.toml", "[simulator]\nrobot = \"robot.toml\"\ncommand = [\"" TILLER_TEST_COMMAND
                      "\", \"sim\", \"robot.toml\", \"--serve\", \"lines\"]\n");
  }
  void write(const std::string& name, const std::string& text) { std::ofstream(folder_ + "/" + name) << text; }

  Ended episodes(const std::string& box, const std::string& count = "2") {
    return run({"run", "robot.toml", "--sim", "--episodes", count, "--seconds", "0.8", "--method", "bayes_sim",
                "--simulator", box, "--simulations", "160", "--iterations", "2", "--posterior", "posterior.json"});
  }
  json posterior() const { return json::parse(text_of("posterior.json"), nullptr, false); }
};

// The mass's mean and deviation by the mixture that the next run's particles are drawn from.
void moments(const json& posterior, double& mean, double& sd) {
  double sum = 0.0, square = 0.0;
  for (const json& normal : posterior["mixture"]) {
    const double w = normal["weight"], m = normal["mean"][0], c = normal["covariance"][0][0];
    sum += w * m, square += w * (m * m + c);
  }
  mean = sum, sd = std::sqrt(square - sum * sum);
}

TEST_F(SimulatorCommand, EpisodesLearnFromABlackBoxAndGoOnFromItsMixture) {
  const Ended first = episodes("box.toml");
  ASSERT_EQ(first.code, 0) << first.out;
  const json learnt = posterior();
  ASSERT_TRUE(learnt.is_object()) << first.out;
  EXPECT_EQ(learnt["source"]["episodes"], 2);
  double mean = 0, sd = 0;
  moments(learnt, mean, sd);
  EXPECT_LT(sd, 0.2 * 0.5 / std::sqrt(12.0));  // the prior's
  EXPECT_NEAR(mean, 0.65, 5 * sd + 0.01);      // a truth of another stepper, noise in its motion
  const Ended second = episodes("box.toml", "1");
  ASSERT_EQ(second.code, 0) << second.out;
  EXPECT_EQ(posterior()["source"]["episodes"], 3);
  EXPECT_FALSE(contains(second.out, "begins with the robot file's priors")) << second.out;
}

TEST_F(SimulatorCommand, ABlackBoxThatEndsLeavesThePosteriorAsItWas) {
  write("dead.toml", "[simulator]\nrobot = \"robot.toml\"\ncommand = [\"false\"]\n");
  const Ended ended = episodes("dead.toml");
  EXPECT_NE(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "ended with exit code 1 before it had greeted; run its command by hand"))
      << ended.out;
  EXPECT_EQ(text_of("posterior.json"), "");
}

TEST_F(SimulatorCommand, IdentifyTakesABlackBoxInTheModelsPlace) {
  ASSERT_EQ(run({"run", "robot.toml", "--sim", "--seconds", "1", "--log", "log.csv"}).code, 0);
  const std::string box = TILLER_TEST_COMMAND " sim robot.toml --serve lines";
  const Ended good = run({"identify", "robot.toml", "log.csv", "--simulator", box, "--simulations", "400"});
  EXPECT_EQ(good.code, 0) << good.out;
  EXPECT_TRUE(contains(good.out, "tiller infer box.toml log.csv")) << good.out;
  EXPECT_TRUE(contains(good.out, "by bayes_sim, summary linear: 440 simulations")) << good.out;
  const Ended refused = run({"identify", "robot.toml", "log.csv", "--simulator", box, "--method", "reps"});
  EXPECT_EQ(refused.code, 1) << refused.out;
  EXPECT_TRUE(contains(refused.out, "--method: is of models that tiller computes")) << refused.out;
  EXPECT_TRUE(contains(refused.out, "tiller infer box.toml log.csv")) << refused.out;
  const Ended absent = run({"identify", "robot.toml", "log.csv", "--simulator", "./no_such_box --fast"});
  EXPECT_NE(absent.code, 0);
  EXPECT_TRUE(contains(absent.out, "cannot start ./no_such_box in .: No such file or directory; check folder"))
      << absent.out;
}

}  // namespace
}  // namespace tiller::test
