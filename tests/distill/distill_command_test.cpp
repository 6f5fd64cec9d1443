// `tiller distill` end to end: what it writes can be read, run and exported.
#include <cmath>

#include "command_rig.hpp"

namespace {

namespace fs = std::filesystem;
using namespace tiller::test;

class Distill : public Command {
 protected:
  void SetUp() override {
    Command::SetUp();
    std::ifstream file(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml", std::ios::binary);
    std::stringstream stream;
    stream << file.rdbuf();
    std::string text = stream.str();
    const std::string from = "[start]\n";
    ASSERT_NE(text.find(from), std::string::npos);
    text.replace(text.find(from), from.size(), "[start]\nstate = { angle_rad = 3.0 }\n");
    std::ofstream(folder_ + "/hold.toml") << text;
  }
  static Words distill(const Words& more) {
    Words all = {"distill",      "hold.toml", "-o",         "p.json", "--teacher", "ilqr", "--hidden", "8",
                 "--iterations", "1",         "--episodes", "4",      "--seconds", "1",    "--test",   "0",
                 "--validation", "2",         "--no-page"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
};

TEST_F(Distill, WritesAPolicyAndARobotFileThatRunsAndExports) {
  const Ended taught = run(distill({}));
  ASSERT_EQ(taught.code, 0) << taught.out;
  EXPECT_NE(taught.out.find("73 weights"), std::string::npos) << taught.out;  // 8 (1 + 7) + 1 (1 + 8)
  EXPECT_NE(taught.out.find("round 1 of 1"), std::string::npos) << taught.out;
  const std::string robot = text_of("hold_policy.toml");
  EXPECT_NE(robot.find("kind = \"policy\""), std::string::npos);
  EXPECT_NE(robot.find("fallback = \"ilqr\""), std::string::npos);
  EXPECT_NE(robot.find("file = \"p.json\""), std::string::npos);
  const Ended ran = run({"run", "hold_policy.toml", "--sim", "--seconds", "1"});
  EXPECT_EQ(ran.code, 0) << ran.out;
  const Ended exported = run({"export", "hold_policy.toml"});
  EXPECT_EQ(exported.code, 0) << exported.out;
  EXPECT_NE(exported.out.find("tiller_planner_policy"), std::string::npos);
  EXPECT_NE(exported.out.find("[73]"), std::string::npos);
}

TEST_F(Distill, SameSeedSameBytes) {
  ASSERT_EQ(run(distill({"--threads", "1"})).code, 0);
  const std::string first = text_of("p.json");
  ASSERT_EQ(run(distill({"--threads", "2"})).code, 0);
  EXPECT_EQ(text_of("p.json"), first);
  ASSERT_EQ(run(distill({"--seed", "2"})).code, 0);
  EXPECT_NE(text_of("p.json"), first);
}

TEST_F(Distill, TellsWhatIsWrong) {
  Ended bad = run(distill({"--teacher", "oracle"}));
  EXPECT_EQ(bad.code, 1);
  bad = run({"distill", "hold.toml", "-o", "p.json", "--reads", "state,future"});
  EXPECT_EQ(bad.code, 1);
  EXPECT_NE(bad.out.find("future"), std::string::npos) << bad.out;
  bad = run({"distill", "hold.toml", "-o", "p.json", "--hidden", "65"});
  EXPECT_EQ(bad.code, 1);
  EXPECT_NE(bad.out.find("1..64"), std::string::npos) << bad.out;
  bad = run({"distill", "hold.toml", "-o", "hold.toml/p.json"});  // below a file there is no folder
  EXPECT_EQ(bad.code, 1);
  EXPECT_NE(bad.out.find("hold.toml/p.json"), std::string::npos) << bad.out;
  EXPECT_FALSE(fs::exists(folder_ + "/p.json"));
}

}  // namespace
