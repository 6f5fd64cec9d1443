// `tiller imitate` end to end: demonstrations by the planner itself on the model, and everything that may be wrong.
#include <cmath>

#include "command_rig.hpp"

namespace {

using namespace tiller::test;

class Imitate : public Command {
 protected:
  void SetUp() override {
    Command::SetUp();
    std::ifstream file(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml", std::ios::binary);
    std::stringstream stream;
    stream << file.rdbuf();
    text_ = stream.str();
    std::ofstream(folder_ + "/robot.toml") << text_;
  }
  /// 80 rows of a pendulum that is pushed; `column` gives the cell of the input.
  void write_log(const std::string& name, int rows, const std::string& header, double push) {
    std::ofstream log(folder_ + "/" + name);
    log << header << "\n";
    double angle = 0, rate = 0;
    for (int k = 0; k < rows; ++k) {
      const double torque = push * std::sin(0.1 * k);
      log << 0.02 * k << "," << angle << "," << torque << "\n";
      for (int s = 0; s < 20; ++s) {
        rate += 0.001 * (torque - 0.05 * rate - 0.5 * 9.81 * 0.5 * std::sin(angle)) / (0.5 * 0.25);
        angle += 0.001 * rate;
      }
    }
  }
  std::string text_;
  static constexpr const char* kHeader = "time_s,angle_rad,torque_Nm";
};

TEST_F(Imitate, LearnsWeightsAndWritesAFileThatRuns) {
  write_log("demo.csv", 120, kHeader, 1.0);
  const Ended ended = run({"imitate", "robot.toml", "demo.csv", "--horizon", "whole", "-o", "learnt.toml"});
  ASSERT_EQ(ended.code, 0) << ended.out;
  EXPECT_NE(ended.out.find("cost.state_weight.angle_rad"), std::string::npos) << ended.out;
  EXPECT_NE(ended.out.find("kept: cost.input_weight.torque_Nm = 0.01"), std::string::npos) << ended.out;
  EXPECT_NE(text_of("learnt.toml"), text_);
  EXPECT_EQ(run({"check", "learnt.toml"}).code, 0);
}

TEST_F(Imitate, ThePageIsTheFileThatWasNamed) {
  write_log("demo.csv", 120, kHeader, 1.0);
  const Ended ended = run({"imitate", "robot.toml", "demo.csv", "--horizon", "whole", "--page", "out/shown.html"});
  ASSERT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(fs::is_regular_file(folder_ + "/out/shown.html")) << ended.out;
  EXPECT_NE(text_of("out/shown.html").find("cost.state_weight.angle_rad"), std::string::npos);
  EXPECT_TRUE(fs::is_regular_file(folder_ + "/out/shown.json")) << ended.out;
}

TEST_F(Imitate, LearnsATarget) {
  write_log("demo.csv", 120, kHeader, 1.0);
  const Ended ended = run({"imitate", "robot.toml", "demo.csv", "--horizon", "whole", "--target", "angle_rad"});
  ASSERT_EQ(ended.code, 0) << ended.out;
  EXPECT_NE(ended.out.find("cost.target.angle_rad"), std::string::npos) << ended.out;
  EXPECT_NE(run({"imitate", "robot.toml", "demo.csv", "--target", "angle_rat"}).out.find("did you mean angle_rad"),
            std::string::npos);
}

TEST_F(Imitate, WritesAPolicyThatRuns) {
  write_log("demo.csv", 120, kHeader, 1.0);
  const Ended ended =
      run({"imitate", "robot.toml", "demo.csv", "--method", "wasserstein", "--iterations", "3", "-o", "acts.toml"});
  ASSERT_EQ(ended.code, 0) << ended.out;
  EXPECT_NE(text_of("acts_policy.json").find("\"sin angle_rad\""), std::string::npos) << ended.out;
  EXPECT_NE(text_of("acts.toml").find("fallback = \"cem\""), std::string::npos) << text_of("acts.toml");
  const Ended ran = run({"run", "acts.toml", "--sim", "--seconds", "0.2", "--quiet"});
  EXPECT_EQ(ran.code, 0) << ran.out;
}

// Opposite pushes from the same rest: no function of the state does both.
TEST_F(Imitate, WarnsOfAPolicyThatDoesSomethingElse) {
  write_log("demo.csv", 120, kHeader, 1.0);
  write_log("against.csv", 120, kHeader, -0.5);
  const auto acts = [&](std::vector<std::string> logs) {
    std::vector<std::string> words = {"imitate", "robot.toml"};
    words.insert(words.end(), logs.begin(), logs.end());
    words.insert(words.end(), {"--method", "wasserstein", "--iterations", "1"});
    return run(words);
  };
  const Ended both = acts({"demo.csv", "against.csv"});
  ASSERT_EQ(both.code, 0) << both.out;
  EXPECT_NE(both.out.find("than 1 of 2 demonstrations show, on against.csv by 1."), std::string::npos) << both.out;
  EXPECT_EQ(acts({"demo.csv"}).out.find("not fit for the robot"), std::string::npos);
}

TEST_F(Imitate, TellsWhatIsWrong) {
  write_log("short.csv", 30, kHeader, 1.0);
  write_log("still.csv", 120, kHeader, 0.0);
  write_log("no_input.csv", 120, "time_s,angle_rad,something", 1.0);
  write_log("other.csv", 120, "time_s,cart_m,force_N", 1.0);
  std::ofstream(folder_ + "/nan.csv") << kHeader << "\n0,0,nan\n0.02,0.1,1\n";
  const struct {
    const char *log, *says;
  } cases[] = {{"short.csv", "demonstrate longer"},
               {"still.csv", "still.csv"},
               {"no_input.csv", "torque_Nm"},
               {"other.csv", "angle_rad"},
               {"nan.csv", "nan"}};
  for (const auto& c : cases) {
    const Ended ended = run({"imitate", "robot.toml", c.log});
    EXPECT_NE(ended.code, 0) << c.log;
    EXPECT_NE(ended.out.find(c.says), std::string::npos) << c.log << ": " << ended.out;
  }
}

TEST_F(Imitate, NamesKeysThatAreNone) {
  write_log("demo.csv", 120, kHeader, 1.0);
  const Ended ended = run({"imitate", "robot.toml", "demo.csv", "--keep", "cost.state_weight.angle_rat"});
  EXPECT_NE(ended.code, 0);
  EXPECT_NE(ended.out.find("did you mean cost.state_weight.angle_rad"), std::string::npos) << ended.out;
  EXPECT_NE(run({"imitate", "robot.toml", "demo.csv", "--horizon", "soon"}).code, 0);
  EXPECT_NE(run({"imitate", "robot.toml", "demo.csv", "-o", "robot.toml"}).code, 0);
}

}  // namespace
