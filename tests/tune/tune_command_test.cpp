// `tiller tune` end to end, on a pendulum whose planner looks too short a way ahead and hardly tries anything.
#include <sys/resource.h>

#include <cmath>

#include "command_rig.hpp"

namespace {

namespace fs = std::filesystem;
using namespace tiller::test;

class Tune : public Command {
 protected:
  void SetUp() override {
    Command::SetUp();
    std::ifstream file(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml", std::ios::binary);
    std::stringstream stream;
    stream << file.rdbuf();
    std::string text = stream.str();
    replace(text, "horizon = 75\nknots = 10\nrollouts = 256\nparticles = 8\niterations = 3",
            "horizon = 5\nknots = 5\nrollouts = 32\nparticles = 2\niterations = 2");
    replace(text, "noise_sd = { torque_Nm = 1.0 }", "noise_sd = { torque_Nm = 0.05 }");
    std::ofstream(folder_ + "/bad.toml") << text;
  }
  static void replace(std::string& text, const std::string& from, const std::string& to) {
    ASSERT_NE(text.find(from), std::string::npos) << from;
    text.replace(text.find(from), from.size(), to);
  }
  static Words tune(const Words& more) {
    Words all = {"tune",      "bad.toml",
                 "--search",  "planner.horizon=5:50",
                 "--search",  "planner.noise_sd=log:0.05:3",
                 "--seconds", "3",
                 "--train",   "2",
                 "--test",    "4",
                 "--quiet"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  /// Mean stage cost of the first episode of `tiller run` with a seed.
  double run_cost(const std::string& robot, int seed) {
    const Ended ended =
        run({"run", robot, "--sim", "--seconds", "3", "--episodes", "2", "--seed", std::to_string(seed)});
    const std::string mark = "episode 1: cost ";
    const std::size_t at = ended.out.find(mark);
    EXPECT_NE(at, std::string::npos) << ended.out;
    return at == std::string::npos ? NAN : std::strtod(ended.out.c_str() + at + mark.size(), nullptr);
  }
  /// The cells of a row of the log; row 0 is the first trial.
  Words row(const std::string& log, std::size_t index) const {
    std::istringstream rows(text_of(log));
    std::string line;
    for (std::size_t i = 0; i < index + 3; ++i) std::getline(rows, line);
    std::istringstream cells(line);
    Words all;
    for (std::string cell; std::getline(cells, cell, ',');) all.push_back(cell);
    return all;
  }
  std::ptrdiff_t rows(const std::string& log) const {
    const std::string text = text_of(log);
    return std::count(text.begin(), text.end(), '\n') - 2;
  }
};

TEST_F(Tune, ImprovesABadlyTunedPendulumOnSeedsItHasNotSeen) {
  const Ended ended = run(tune({"--trials", "16"}));
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "trained on seeds 1..2")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "others: seeds 3..6")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "better on 4 of 4")) << ended.out;
  EXPECT_EQ(rows("bad_tuned.csv"), 16);
  // what the log says of the file as it was is what a run of it costs
  const Words first = row("bad_tuned.csv", 0);
  ASSERT_GE(first.size(), 8u);
  for (int seed : {1, 2}) {
    const double cost = run_cost("bad.toml", seed),
                 logged = -std::strtod(first[static_cast<std::size_t>(5 + seed)].c_str(), nullptr);
    EXPECT_NEAR(cost, logged, 1e-3 * logged) << "four digits are printed";
  }
  // and, without tune's own counting, a fifth is saved on other plants
  double before = 0, after = 0;
  for (int seed : {3, 4, 5, 6}) {
    before += run_cost("bad.toml", seed);
    after += run_cost("bad_tuned.toml", seed);
  }
  EXPECT_LT(after, 0.8 * before) << ended.out;
}

TEST_F(Tune, ResumedAfterACutIsAnUncutRun) {
  ASSERT_EQ(run(tune({"--trials", "7", "--log", "whole.csv", "-o", "whole.toml"})).code, 0);
  const pid_t child = start(tune({"--trials", "7", "--log", "cut.csv", "-o", "cut.toml", "--threads", "1"}));
  for (int i = 0; i < 6000 && (!fs::exists(folder_ + "/cut.csv") || rows("cut.csv") < 3); ++i) usleep(10000);
  kill(child, SIGKILL);
  (void)finish(child);
  const std::ptrdiff_t kept = rows("cut.csv");
  EXPECT_GE(kept, 3);
  EXPECT_FALSE(fs::exists(folder_ + "/cut.toml") && kept < 7);
  const Ended again = run(tune({"--trials", "7", "--log", "cut.csv", "-o", "cut.toml", "--resume"}));
  EXPECT_EQ(again.code, 0) << again.out;
  EXPECT_EQ(text_of("cut.csv"), text_of("whole.csv"));
  EXPECT_EQ(text_of("cut.toml"), text_of("whole.toml"));
}

TEST_F(Tune, ThreadsDoNotChangeTheResult) {
  for (const char* threads : {"1", "2", "5"})
    ASSERT_EQ(run({"tune", "bad.toml", "--search", "planner.noise_sd=log:0.05:3", "--seconds", "2", "--train", "5",
                   "--test", "2", "--trials", "4", "--quiet", "--threads", threads, "--log",
                   threads + std::string(".csv"), "-o", threads + std::string(".toml")})
                  .code,
              0);
  EXPECT_EQ(text_of("1.csv"), text_of("2.csv"));
  EXPECT_EQ(text_of("1.csv"), text_of("5.csv"));
  EXPECT_EQ(text_of("1.toml"), text_of("5.toml"));
}

// By its own cost, a file that weighs the angle a thousandth as much would have a thousandth of the cost.
TEST_F(Tune, ACostThatIsSearchedDoesNotJudgeItself) {
  const Ended ended = run({"tune", "bad.toml", "--search", "cost.state_weight.angle_rad=log:0.002:0.008", "--seconds",
                           "3", "--train", "2", "--test", "2", "--trials", "4", "--quiet"});
  EXPECT_EQ(ended.code, 0) << ended.out;
  const double own = std::strtod(row("bad_tuned.csv", 0)[2].c_str(), nullptr);
  ASSERT_LT(own, -20.0) << "it hangs: 4 pi^2 is 39.5";
  for (std::size_t trial = 1; trial < 4; ++trial)
    EXPECT_LT(std::strtod(row("bad_tuned.csv", trial)[2].c_str(), nullptr), 0.5 * own) << trial;
}

TEST_F(Tune, CtrlCKeepsTheTrialsAndSaysHowToGoOn) {
  const pid_t child = start(tune({"--trials", "1000"}));
  for (int i = 0; i < 6000 && (!fs::exists(folder_ + "/bad_tuned.csv") || rows("bad_tuned.csv") < 1); ++i)
    usleep(10000);
  kill(child, SIGINT);
  const Ended ended = finish(child);
  EXPECT_EQ(ended.code, 130) << ended.out;
  EXPECT_TRUE(contains(ended.out, "--resume goes on")) << ended.out;
  EXPECT_GE(rows("bad_tuned.csv"), 1);
  EXPECT_FALSE(fs::exists(folder_ + "/bad_tuned.toml"));
}

TEST_F(Tune, AFullDiskIsToldAndTheLogCanBeGoneOnWith) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit full = before;
  full.rlim_cur = 420;  // the two first lines and a row
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &full), 0);
  const pid_t child = start(tune({"--trials", "5"}));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  const Ended ended = finish(child);
  EXPECT_EQ(ended.code, 1) << ended.out;
  EXPECT_TRUE(contains(ended.out, "bad_tuned.csv: cannot be written")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "free space")) << ended.out;
  const std::string log = text_of("bad_tuned.csv");
  ASSERT_FALSE(log.empty());
  EXPECT_EQ(log.back(), '\n') << "no part of a row is left:\n" << log;
  EXPECT_GE(rows("bad_tuned.csv"), 1);
  EXPECT_LT(rows("bad_tuned.csv"), 5);
  EXPECT_EQ(run(tune({"--trials", "5", "--resume"})).code, 0);
  EXPECT_EQ(rows("bad_tuned.csv"), 5);
}

TEST_F(Tune, WrongInputEndsWithOneAndARemedy) {
  std::ofstream(folder_ + "/there.csv") << "something\n";
  std::ofstream(folder_ + "/file") << "no folder\n";
  const struct {
    Words arguments;
    const char* says;
  } wrong[] = {{{"tune", "bad.toml", "--search", "planner.horizn=5:50"}, "did you mean planner.horizon?"},
               {{"tune", "bad.toml", "--search", "safety.hold_gain=1:2"}, "yours to set"},
               {{"tune", "bad.toml", "--search", "planner.horizon=50:5"}, "write the smaller number first"},
               {{"tune", "bad.toml", "--search", "planner.horizon=5:50", "--search", "planner.horizon=6:9"}, "twice"},
               {{"tune", "none.toml"}, "none.toml: cannot be read"},
               {tune({"--log", "there.csv"}), "go on with --resume"},
               {tune({"--log", "there.csv", "--resume"}), "made with other settings"},
               {tune({"-o", "file/tuned.toml"}), "-o file/tuned.toml"},
               {tune({"-o", "bad.toml"}), "is the robot file itself"},
               {tune({"--trials", "1"}), "--trials"}};
  for (const auto& w : wrong) {
    const Ended refused = run(w.arguments);
    EXPECT_EQ(refused.code, 1) << refused.out;
    EXPECT_TRUE(contains(refused.out, w.says)) << "expected '" << w.says << "' in\n" << refused.out;
  }
  EXPECT_EQ(text_of("there.csv"), "something\n");
}

}  // namespace
