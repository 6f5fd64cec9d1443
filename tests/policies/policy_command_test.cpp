// `tiller policy` end to end: each method writes a policy, the same seed the same one, and what is wrong is told.

#include "command_rig.hpp"

namespace {

using namespace tiller::test;

class PolicyCommand : public Command {
 protected:
  static Words policy(const Words& more) {
    Words all = {"policy", std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml", "--seconds", "1.5", "--quiet"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  bool has(const std::string& text, const std::string& what) const { return text.find(what) != std::string::npos; }
};

const Words kShort = {"--trials", "1", "--bumps", "4", "--evaluations", "5"};

TEST_F(PolicyCommand, WritesAPolicyAndItsPage) {
  Words words = kShort;
  words.insert(words.end(), {"-o", "p.json", "--page", "p.html"});
  const Ended ended = run(policy(words));
  EXPECT_EQ(ended.code, 0) << ended.out;
  const std::string text = text_of("p.json");
  EXPECT_TRUE(has(text, "\"tiller policy\"")) << text;
  EXPECT_TRUE(has(text, "\"sin angle_rad\"")) << text;
  EXPECT_TRUE(has(text_of("p.html"), "cost by trial"));
  words[words.size() - 3] = "again.json";
  EXPECT_EQ(run(policy(words)).code, 0);
  EXPECT_EQ(text_of("again.json"), text);
}

TEST_F(PolicyCommand, GuidedWritesANetwork) {
  const Ended ended = run(policy({"--method", "guided", "--iterations", "1", "--conditions", "1", "-o", "g.json"}));
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(has(text_of("g.json"), "\"tanh\"")) << ended.out;
}

TEST_F(PolicyCommand, TellsWhatIsMissing) {
  std::ifstream file(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml");
  std::stringstream text;
  text << file.rdbuf();
  std::ofstream(folder_ + "/bare.toml") << text.str().substr(0, text.str().find("[sim]"));
  const Ended ended = run({"policy", "bare.toml", "-o", "p.json"});
  EXPECT_EQ(ended.code, 1) << ended.out;
  EXPECT_TRUE(has(ended.out, "has no [sim] section")) << ended.out;
  EXPECT_NE(run(policy({"--method", "magic"})).code, 0);
  const Ended outputs = run({"policy", std::string(TILLER_TEST_ROBOTS) + "/two_link_arm.toml", "--method", "guided"});
  EXPECT_EQ(outputs.code, 1) << outputs.out;
  EXPECT_TRUE(has(outputs.out, "costs of states alone")) << outputs.out;
}

}  // namespace
