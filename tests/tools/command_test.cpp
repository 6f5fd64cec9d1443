// The tiller program as a user meets it: help, exit codes, runs, Ctrl-C, logs that cannot be written.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>
#include <tuple>

#include "command_rig.hpp"
#include "tools/identify/laboratory.hpp"
#include "tools/logs/record_file.hpp"

namespace {

namespace fs = std::filesystem;
using namespace tiller::test;

const std::string kCartPole = std::string(TILLER_TEST_ROBOTS) + "/cart_pole.toml";

TEST_F(Command, HelpTeaches) {
  const Ended top = run({"--help"});
  EXPECT_EQ(top.code, 0);
  EXPECT_TRUE(contains(top.out, "First steps:")) << top.out;
  for (const char* name : {"demo", "run", "sim", "identify", "excite", "export", "replay", "explain", "view", "new",
                           "check", "size", "models", "effects", "planners", "help", "version"}) {
    const Ended help = run({name, "--help"});
    EXPECT_EQ(help.code, 0) << name;
    const std::size_t examples = help.out.find("Examples:");
    ASSERT_NE(examples, std::string::npos) << name << " has no examples";
    const std::string after = help.out.substr(examples);
    int count = 0;
    const std::string call = std::string("\n  tiller ");
    for (std::size_t at = 0; (at = after.find(call, at)) != std::string::npos; ++at) ++count;
    EXPECT_GE(count, 2) << name << " shows fewer than two examples:\n" << after;
  }
  EXPECT_TRUE(contains(run({"help", "robot-file"}).out, "[parameters]"));
  EXPECT_TRUE(contains(run({"help", "demos"}).out, "did you mean demo?"));
}

TEST_F(Command, TellsAndChecks) {
  const Ended version = run({"version"}), flag = run({"--version"});
  EXPECT_EQ(version.out.rfind("tiller 0.", 0), 0u);
  EXPECT_EQ(flag.out, version.out);
  EXPECT_EQ(flag.code, 0);
  EXPECT_TRUE(contains(run({"models"}).out, "parameters  cart_mass_kg, pole_mass_kg, half_length_m"));
  EXPECT_TRUE(contains(run({"effects"}).out, "viscous_friction"));
  const std::string planners = run({"planners"}).out;
  const std::string of_cem =
      planners.substr(planners.find("\ncem "), planners.find("\nmppi ") - planners.find("\ncem "));
  EXPECT_TRUE(contains(of_cem, "elite_fraction")) << planners;
  EXPECT_FALSE(contains(of_cem, "temperature")) << planners;
  const Ended check = run({"check", kCartPole});
  EXPECT_EQ(check.code, 0);
  EXPECT_TRUE(contains(check.out, "pole_mass_kg             uniform on [0.05, 0.15]")) << check.out;
}

TEST_F(Command, WrongInputEndsWithOneAndARemedy) {
  struct Case {
    Words arguments;
    const char* says;
  };
  std::ofstream(folder_ + "/wrong.toml") << "[model]\nname = \"cartpole\"\n";
  std::ofstream(folder_ + "/text.rec") << "not a record";
  const Case cases[] = {
      {{"run", "none.toml"}, "none.toml: cannot be read"},
      {{"run", "wrong.toml", "--sim"}, "wrong.toml:2: model.name = \"cartpole\""},
      {{"check", "wrong.toml"}, "did you mean cart_pole?"},
      {{"run", kCartPole, "--sim", "--planner", "cme"}, "did you mean cem?"},
      {{"run", kCartPole, "--transport", "serial"}, "--transport"},
      {{"run", kCartPole, "--transport", "can", "--wait", "1"}, "[transport]"},
      {{"run", kCartPole, "--sim", "--seconds", "-1"}, "--seconds"},
      {{"replay", "text.rec", kCartPole}, "is no record of tiller"},
      {{"rum"}, "did you mean run?"},
      {{"run", kCartPole, "--sim", "--reprot", "page.html"},
       "tiller run: there is no option --reprot; did you mean --report?"},
      {{"run", kCartPole, "--sim", "--second=3"}, "tiller run: there is no option --second; did you mean --seconds?"},
      {{"export", "--prefx", "arm"}, "tiller export: there is no option --prefx; did you mean --prefix?"},
      {{"check", kCartPole, "--zebra"}, "there is no option --zebra; all of them: tiller check --help"},
      {{"--quite", "run"}, "tiller run: there is no option --quite; did you mean --quiet?"},
      {{"can", "docter"}, "tiller can: there is no command 'docter'; did you mean doctor?"},
      {{"check", kCartPole, "more.toml"}, "tiller check: 'more.toml' is one argument too many"},
      {{}, "subcommand is required"},
  };
  for (const Case& wrong : cases) {
    const Ended ended = run(wrong.arguments);
    EXPECT_EQ(ended.code, 1) << ended.out;
    EXPECT_TRUE(contains(ended.out, wrong.says)) << "expected '" << wrong.says << "' in\n" << ended.out;
  }
}

/// A robot file's text with some of it replaced.
std::string variant(const std::string& path, const std::vector<std::pair<std::string, std::string>>& changes) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  std::string changed = text.str();
  for (const auto& [from, to] : changes) {
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) changed.replace(at, from.size(), to);
  }
  return changed;
}

TEST_F(Command, APeriodInMillisecondsIsHintedAt) {
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  std::ofstream(folder_ + "/long.toml") << variant(
      pendulum, {{"period_s = 0.02", "period_s = 20"}, {"sensor_timeout_s = 0.1", ""}});
  const Ended check = run({"check", "long.toml"});
  EXPECT_EQ(check.code, 0) << check.out;
  EXPECT_TRUE(contains(check.out, "long.toml:8: model.period_s = 20: ")) << check.out;
  EXPECT_TRUE(contains(check.out, "if 20 ms is meant, write period_s = 0.02")) << check.out;
  // the error that no number of substeps mends is not told as mended
  EXPECT_FALSE(contains(check.out, "below 0.1 with 64 substeps")) << check.out;
  EXPECT_TRUE(contains(check.out, " with 64 substeps)") && contains(check.out, "(still ")) << check.out;
  EXPECT_TRUE(contains(check.out, "even with 64 substeps")) << check.out;
}

// Where the robot file is silent the model decides, and a run says what it decided and why, as check does.
TEST_F(Command, ARunSaysHowFarItLooksAndHowFinelyItSteps) {
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  std::ofstream(folder_ + "/silent.toml") << variant(pendulum, {{"horizon = 75\n", ""}});
  std::ofstream(folder_ + "/short.toml") << variant(pendulum, {{"horizon = 75", "horizon = 50"}});
  const Ended chosen = run({"run", "silent.toml", "--sim", "--seconds", "0.1"});
  EXPECT_EQ(chosen.code, 0);
  EXPECT_FALSE(contains(chosen.out, "is short")) << chosen.out;
  const Ended brief = run({"run", "short.toml", "--sim", "--seconds", "0.1"});
  EXPECT_TRUE(contains(brief.out, "plan: 50 steps ahead (1 s); horizon = 50 is short: the model asks for"))
      << brief.out;
  // what it asks for is what it gets where the file is silent
  const std::size_t asked = brief.out.find("asks for ") + 9;
  const std::string periods = brief.out.substr(asked, brief.out.find(' ', asked) - asked);
  EXPECT_TRUE(contains(chosen.out, "plan: " + periods + " steps ahead")) << chosen.out;
  EXPECT_TRUE(contains(chosen.out, "period: 0.02 s, 1 substep(s); step error ")) << chosen.out;
  EXPECT_TRUE(contains(chosen.out, "of the noise expected of ")) << chosen.out;
  EXPECT_FALSE(contains(run({"run", "short.toml", "--sim", "--seconds", "0.1", "--quiet"}).out, "plan: "));
}

// 8192 rollouts of a planner that takes 1 ms for 256 of them, in 0.5 ms: a busy machine makes it longer only.
TEST_F(Command, ATickThatDoesNotFitItsPeriodIsWarnedOf) {
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  std::ofstream(folder_ + "/slow.toml") << variant(
      pendulum, {{"period_s = 0.02", "period_s = 0.0005"}, {"rollouts = 256", "rollouts = 8192"}});
  const Ended check = run({"check", "slow.toml"});
  EXPECT_EQ(check.code, 0);
  for (const char* part : {"predicted on one thread (", "model steps of", "measured; period 500 us",
                           "slow.toml: a tick measures", "longer than the period of 500 us", "deadline_us", "rollouts"})
    EXPECT_TRUE(contains(check.out, part)) << part << " in\n" << check.out;
  const Ended sim = run({"run", "slow.toml", "--sim", "--seconds", "0.005", "--quiet"});
  EXPECT_EQ(sim.code, 0);
  EXPECT_TRUE(contains(sim.out, "slow.toml: a tick is predicted to take")) << sim.out;
  EXPECT_TRUE(contains(sim.out, "of a period of 0.5 ms")) << sim.out;
}

TEST_F(Command, LockstepRunsRepeatToTheLastBitOnAnyThreads) {
  const Words base = {"run", kCartPole, "--sim", "--seconds", "1", "--seed", "5", "--quiet", "--log"};
  for (const char* log : {"a.csv", "b.csv", "c.csv"}) {
    Words arguments = base;
    arguments.emplace_back(log);
    if (std::string(log) == "c.csv") arguments.insert(arguments.end(), {"--threads", "2"});
    ASSERT_EQ(run(arguments).code, 0);
  }
  const std::string a = first_columns("a.csv", 4);
  EXPECT_EQ(std::count(a.begin(), a.end(), '\n'), 51);  // header, and ticks at 0, 0.02, ..., 0.98 s
  EXPECT_EQ(a, first_columns("b.csv", 4));
  EXPECT_EQ(a, first_columns("c.csv", 4));
}

TEST_F(Command, AnotherSeedIsAnotherRun) {
  ASSERT_EQ(run({"run", kCartPole, "--sim", "--seconds", "0.5", "--seed", "5", "--quiet", "--log", "a.csv"}).code, 0);
  ASSERT_EQ(run({"run", kCartPole, "--sim", "--seconds", "0.5", "--seed", "6", "--quiet", "--log", "b.csv"}).code, 0);
  EXPECT_NE(first_columns("a.csv", 4), first_columns("b.csv", 4));
}

TEST_F(Command, ARecordReplaysToTheLastBit) {
  ASSERT_EQ(run({"run", kCartPole, "--sim", "--seconds", "1", "--quiet", "--record", "run.rec"}).code, 0);
  const Ended same = run({"replay", "run.rec", kCartPole});
  EXPECT_EQ(same.code, 0) << same.out;
  EXPECT_TRUE(contains(same.out, ", 0 different")) << same.out;
  // one bit of one recorded command changed, in tick 26 of 0 to 49: found
  std::string bytes = text_of("run.rec");
  constexpr std::size_t kEntry = sizeof(tiller::tools::RecordEntry);
  ASSERT_GT(bytes.size(), 50 * kEntry);
  const std::size_t command = offsetof(tiller::tools::RecordEntry, record) + offsetof(tiller_record_t, command);
  char& bent_byte = bytes[bytes.size() - 24 * kEntry + command + offsetof(tiller_command_t, value) + 4];
  bent_byte = static_cast<char>(bent_byte ^ 1);
  std::ofstream(folder_ + "/bent.rec", std::ios::binary) << bytes;
  const Ended bent = run({"replay", "bent.rec", kCartPole});
  EXPECT_EQ(bent.code, 4);
  EXPECT_TRUE(contains(bent.out, "first difference in tick 26")) << bent.out;
  EXPECT_TRUE(contains(bent.out, "\n  state     angle_rad            recorded ")) << "the state at it: " << bent.out;
}

const std::string kArm = TILLER_TEST_ROBOTS "/two_link_arm.toml";

/// The last row's value of a column.
double last_of(const std::string& csv, const std::string& column) {
  std::istringstream rows(csv);
  std::string header, row, last;
  std::getline(rows, header);
  while (std::getline(rows, row)) last = row;
  std::istringstream names(header), cells(last);
  for (std::string name, cell; std::getline(names, name, ',') && std::getline(cells, cell, ',');)
    if (name == column) return std::stod(cell);
  return NAN;
}

// The tip of an ODE arm, with a load that the controller does not know.
TEST_F(Command, GoalsAreReachedAndReplayed) {
  Words arguments = {"run",   kArm,      "--sim",   "--seconds",
                     "6",     "--quiet", "--goals", TILLER_TEST_ROBOTS "/two_link_arm_goals.csv",
                     "--log", "arm.csv"};
  for (const char* name : {"arm.mcap", "arm.rec"}) arguments.insert(arguments.end(), {"--record", name});
  const Ended ended = run(arguments);
  ASSERT_EQ(ended.code, 0) << ended.out;
  const std::string log = text_of("arm.csv");
  // the goal of 4 s, after 2 s: ODE's first-order steps and the encoder's noise leave a millimetre
  EXPECT_EQ(last_of(log, "goal.tip_x_m"), -0.2);
  EXPECT_NEAR(last_of(log, "out.tip_x_m"), -0.2, 0.005);
  EXPECT_NEAR(last_of(log, "out.tip_z_m"), -0.7, 0.005);
  const double q1 = last_of(log, "true.shoulder_rad"), q2 = last_of(log, "true.elbow_rad");
  EXPECT_NEAR(0.5 * std::sin(q1) + 0.4 * std::sin(q1 + q2), -0.2, 0.005);
  EXPECT_NEAR(last_of(log, "mean.body.mass_kg"), 0.4, 0.01);
  for (const char* name : {"arm.csv", "arm.mcap", "arm.rec"}) {
    const Ended same = run({"replay", name, kArm});
    EXPECT_EQ(same.code, 0) << same.out;
    EXPECT_TRUE(contains(same.out, "600 ticks replayed")) << same.out;
    EXPECT_TRUE(contains(same.out, ", 0 different")) << same.out;
  }
}

TEST_F(Command, OutputsThatAreWrongAreToldByKey) {
  const std::string right = "outputs.tip_x_m = { target = 0.5, weight = 300, terminal_weight = 1000 }";
  const struct {
    const char *text, *says;
  } cases[] = {
      {"outputs.tip_y_m = { target = 0.5, weight = 300 }", "cost.outputs.tip_y_m"},
      {"outputs.tip_x_m = { weight = 300 }", "write where the output is wanted"},
      {"outputs.tip_x_m = { target = 0.5 }", "write what being off the target costs"},
      {"outputs.tip_x_m = { low = 0.5 }", "write what being outside of the bounds costs"},
      {"outputs.tip_x_m = { low = 0.5, high = 0.4, bound_weight = 1 }", "cost.outputs.tip_x_m.low = 0.5"},
      {"outputs.tip_x_m = { target = 0.5, weight = -1 }", "cost.outputs.tip_x_m.weight = -1"},
      {"outputs.tip_x_m = { target = nan, weight = 1 }", "cost.outputs.tip_x_m.target = nan"},
      {"outputs.tip_x_m = 3", "cost.outputs.tip_x_m = 3"},
      {"frames.tip = { position_m = [0, 0, 0], weight = 1 }", "the model has no frame of that name"},
  };
  for (const auto& wrong : cases) {
    std::ofstream(folder_ + "/arm.toml") << variant(kArm, {{right, wrong.text}});
    const Ended ended = run({"check", "arm.toml"});
    EXPECT_EQ(ended.code, 1) << wrong.text;
    EXPECT_TRUE(contains(ended.out, "arm.toml:")) << ended.out;
    EXPECT_TRUE(contains(ended.out, wrong.says)) << "expected '" << wrong.says << "' in\n" << ended.out;
  }
}

TEST_F(Command, GoalsThatAreNoneAreToldByLine) {
  const struct {
    const char *text, *says;
  } cases[] = {{"time_s,tip_x_m\n1,nan\n", "goals.csv:2: tip_x_m = nan: is no finite number"},
               {"time_s,tip_x_m\n1,0.2\n1,0.3\n", "goals.csv:3: time_s = 1: is not after the row before"},
               {"time_s,tip_x_m\n1,0.2,3\n", "goals.csv:2: row: has 3 cells, the header 2"},
               {"time_s,tip_y_m\n1,0.2\n", "goals.csv:1: tip_y_m: is neither a state nor an output"},
               {"tip_x_m\n0.2\n", "goals.csv:1: time_s: the header has no such column"},
               {"time_s,tool_roll_rad\n1,0.2\n", "goals.csv:1: tool_roll_rad: is neither"},
               {"", "goals.csv:1: goals: there is none"}};
  for (const auto& wrong : cases) {
    std::ofstream(folder_ + "/goals.csv") << wrong.text;
    const Ended ended = run({"run", kArm, "--sim", "--seconds", "1", "--quiet", "--goals", "goals.csv"});
    EXPECT_EQ(ended.code, 1) << ended.out;
    EXPECT_TRUE(contains(ended.out, wrong.says)) << "expected '" << wrong.says << "' in\n" << ended.out;
  }
  EXPECT_TRUE(
      contains(run({"run", kArm, "--sim", "--seconds", "1", "--goals", "none.csv"}).out, "none.csv: cannot be read"));
  // goals of outputs that nothing weighs
  std::ofstream(folder_ + "/goals.csv") << "time_s,tip_x_m\n1,0.2\n";
  EXPECT_TRUE(
      contains(run({"run", TILLER_TEST_ROBOTS "/acrobot.toml", "--sim", "--seconds", "1", "--goals", "goals.csv"}).out,
               "the robot file weighs none"));
}

TEST_F(Command, ALogThatIsCutOffSaysSoAndAnMcapBringsItsRobot) {
  Words arguments = {"run", kCartPole, "--sim", "--seconds", "1", "--quiet"};
  for (const char* name : {"run.mcap", "run.rec", "run.lcm"}) arguments.insert(arguments.end(), {"--record", name});
  ASSERT_EQ(run(arguments).code, 0);
  const Ended alone = run({"replay", "run.mcap"});
  EXPECT_EQ(alone.code, 0) << alone.out;
  EXPECT_TRUE(contains(alone.out, "50 ticks replayed")) << alone.out;
  EXPECT_EQ(run({"replay", kCartPole, "run.mcap"}).code, 0) << "the other order means the same";
  const Ended bare = run({"replay", "run.rec"});
  EXPECT_EQ(bare.code, 1);
  EXPECT_TRUE(contains(bare.out, "no robot file is in it")) << bare.out;

  fs::resize_file(folder_ + "/run.rec", fs::file_size(folder_ + "/run.rec") - 100);
  const Ended cut = run({"replay", "run.rec", kCartPole});
  EXPECT_EQ(cut.code, 2) << cut.out;
  EXPECT_TRUE(contains(cut.out, "49 whole ticks; the one behind them is cut off")) << cut.out;
  EXPECT_TRUE(contains(cut.out, "49 ticks replayed")) << cut.out;

  EXPECT_EQ(run({"replay", "run.lcm", kCartPole}).code, 0);
  fs::resize_file(folder_ + "/run.lcm", fs::file_size(folder_ + "/run.lcm") / 2 - 10);
  const Ended half = run({"replay", "run.lcm", kCartPole});
  EXPECT_EQ(half.code, 2) << half.out;
  EXPECT_TRUE(contains(half.out, "cut off in its last event")) << half.out;
}

/// The events of an LCM log: sync word, number, time, two lengths, channel, message; big-endian.
Words events_of(const std::string& log) {
  const auto length = [&](std::size_t at) {
    std::size_t n = 0;
    for (std::size_t i = 0; i < 4; ++i) n = n << 8 | static_cast<unsigned char>(log.at(at + i));
    return n;
  };
  Words events;
  for (std::size_t at = 0; at + 28 <= log.size(); at += events.back().size())
    events.push_back(log.substr(at, 28 + length(at + 20) + length(at + 24)));
  return events;
}

TEST_F(Command, ALogWithAHoleIsJudgedUpToIt) {
  ASSERT_EQ(run({"run", kCartPole, "--sim", "--seconds", "1", "--quiet", "--record", "run.lcm"}).code, 0);
  const Words events = events_of(text_of("run.lcm"));
  ASSERT_EQ(events.size(), 150u) << "measurement, command and telemetry of 50 ticks";
  const auto write = [&](const char* name, const auto& is_lost) {
    std::ofstream file(folder_ + "/" + name, std::ios::binary);
    for (std::size_t i = 0; i < events.size(); ++i)
      if (!is_lost(i)) file << events[i];
  };
  write("measurement.lcm", [](std::size_t i) { return i == 3 * 20; });
  const Ended deaf = run({"replay", "measurement.lcm", kCartPole});
  EXPECT_EQ(deaf.code, 2) << deaf.out;
  EXPECT_TRUE(contains(deaf.out, "1 tick's measurement is missing: 20; from tick 20 on")) << deaf.out;
  EXPECT_TRUE(contains(deaf.out, "equal bits are promised for the 20 ticks before that")) << deaf.out;
  EXPECT_TRUE(contains(deaf.out, "20 ticks replayed on ")) << deaf.out;
  EXPECT_TRUE(contains(deaf.out, ", 0 different, up to the log's first hole\n30 ticks behind it, ")) << deaf.out;
  write("ticks.lcm", [](std::size_t i) { return i / 3 == 30 || i / 3 == 41; });
  const Ended fewer = run({"replay", "ticks.lcm", kCartPole});
  EXPECT_EQ(fewer.code, 2) << fewer.out;
  EXPECT_TRUE(contains(fewer.out, "2 ticks are missing: 30, 41; from tick 31 on")) << fewer.out;
  // in lockstep no deadline ends a plan, so what telemetry tells is known
  write("telemetry.lcm", [](std::size_t i) { return i % 3 == 2 && i / 3 % 7 == 3; });
  const Ended untold = run({"replay", "telemetry.lcm", kCartPole});
  EXPECT_EQ(untold.code, 0) << untold.out;
  EXPECT_TRUE(contains(untold.out, "50 ticks replayed on ")) << untold.out;
  // a hole excuses nothing before it
  const Ended other = run({"replay", "ticks.lcm", kCartPole, "--seed", "9"});
  EXPECT_EQ(other.code, 4) << other.out;
  EXPECT_TRUE(contains(other.out, "first difference in tick 0")) << other.out;
}

TEST_F(Command, ProgressIsAPlainLineEveryHalfSecondWithoutATerminal) {
  const Ended ended = run({"run", kCartPole, "--sim", "--seconds", "2"});
  EXPECT_EQ(ended.code, 0);
  EXPECT_FALSE(contains(ended.out, "\033")) << "escape codes in a file";
  int lines = 0;
  for (std::size_t at = 0; (at = ended.out.find("  ACTIVE  ", at)) != std::string::npos; ++at) ++lines;
  EXPECT_EQ(lines, 4) << ended.out;  // at 0, 0.5, 1 and 1.5 s; the end has a summary
  EXPECT_TRUE(contains(ended.out, "true 0.")) << "the summary shows the truth of a plant in process";
}

TEST_F(Command, CtrlCStopsSafelyAndKeepsTheLog) {
  const pid_t child = start({"run", kCartPole, "--sim", "--real-time", "--log", "run.csv"});
  // the first flush comes after half a second of robot time; wait for it, not for a time
  for (int i = 0; i < 600 && text_of("run.csv").size() < 2000; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  ASSERT_EQ(kill(child, SIGINT), 0);
  const Ended ended = finish(child);
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "(interrupted)")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "log: run.csv")) << ended.out;
  const std::string csv = text_of("run.csv");
  EXPECT_EQ(csv.back(), '\n') << "the last row is whole";
}

// Ticks by the clock, with whatever this machine grants: the run says what it was, and every tick is in the histogram.
TEST_F(Command, RealTimeSaysWhatItGotAndCountsEveryTick) {
  std::ofstream(folder_ + "/clock.toml") << std::ifstream(kCartPole).rdbuf()
                                         << "[realtime]\npriority = 10\ncpus = [63]\nstack_kB = 64\n";
  const Ended ended = run({"run", "clock.toml", "--sim", "--real-time", "--seconds", "1", "--histogram", "times.csv",
                           "--record", "run.mcap"});
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "64 kB of stack touched")) << ended.out;
  if (std::thread::hardware_concurrency() < 64) {
    EXPECT_TRUE(contains(ended.out, "\n  not processor 63: Invalid argument; name processors that this machine has"))
        << ended.out;
  }
  EXPECT_TRUE(contains(ended.out, " periods skipped\n")) << ended.out;
  EXPECT_TRUE(contains(ended.out, " ticks took longer than the period\n")) << ended.out;
  std::istringstream rows(text_of("times.csv"));
  std::string row;
  std::getline(rows, row);
  EXPECT_EQ(row, "upper_us,ticks,wake_ups");
  long ticks = 0, wake_ups = 0;
  for (double upper = -1; std::getline(rows, row);) {
    double edge = 0;
    long of_ticks = 0, of_wake_ups = 0;
    ASSERT_EQ(std::sscanf(row.c_str(), "%lf,%ld,%ld", &edge, &of_ticks, &of_wake_ups), 3) << row;
    EXPECT_GT(edge, upper);
    upper = edge;
    ticks += of_ticks;
    wake_ups += of_wake_ups;
  }
  EXPECT_EQ(ticks, 50);
  EXPECT_EQ(wake_ups, 51);  // the last one finds that the time is over
  // a plant in this process waits for the clock, not the clock for it: the same run, to the last bit
  EXPECT_EQ(run({"replay", "run.mcap", kCartPole}).code, 0);
  const Ended simulated = run({"run", "clock.toml", "--sim", "--seconds", "0.2"});
  EXPECT_FALSE(contains(simulated.out, "real time")) << "simulated time asks for nothing: " << simulated.out;
}

TEST_F(Command, AFullDiskDoesNotStopTheRobotAndIsTold) {
  setenv("TMPDIR", folder_.c_str(), 1);
  const Ended ended = run({"run", kCartPole, "--sim", "--seconds", "1", "--quiet", "--log", "/dev/full"});
  unsetenv("TMPDIR");
  EXPECT_EQ(ended.code, 2) << ended.out;
  EXPECT_TRUE(contains(ended.out, "No space left on device")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "1.00 s, ")) << "the run went on to its end:\n" << ended.out;
  int rescued_rows = 0;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    if (entry.path().filename().string().rfind("tiller-", 0) != 0) continue;
    const std::string rows = text_of(entry.path().filename().string());
    rescued_rows = static_cast<int>(std::count(rows.begin(), rows.end(), '\n'));
  }
  EXPECT_EQ(rescued_rows, 51) << ended.out;
}

// A folder that is missing on the way to a file is made by every output option, and told of.
TEST_F(Command, FoldersOnTheWayToOutputsAreMadeAndTold) {
  const Words base = {"run", kCartPole, "--sim", "--seconds", "0.1", "--quiet"};
  const auto with = [&](const Words& more) {
    Words all = base;
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  const std::pair<Words, std::string> cases[] = {
      {with({"--log", "a/x/run.csv"}), "a/x"},     {with({"--record", "b/run.mcap"}), "b"},
      {with({"--histogram", "c/ticks.csv"}), "c"}, {with({"--save-posterior", "d/prior.json"}), "d"},
      {with({"--report", "e/page.html"}), "e"},    {{"export", kCartPole, "-o", "f/config.c"}, "f"},
  };
  for (const auto& [arguments, folder] : cases) {
    const Ended first = run(arguments);
    EXPECT_TRUE(fs::is_directory(folder_ + "/" + folder)) << first.out;
    EXPECT_TRUE(contains(first.out, "tiller: made the folder " + folder + "\n")) << first.out;
    EXPECT_FALSE(contains(run(arguments).out, "made the folder")) << "it is there now";
  }
}

TEST_F(Command, APageThatCannotBeWrittenIsRefusedBeforeTheRun) {
  fs::create_directory(folder_ + "/taken.html");
  const std::pair<const char*, const char*> cases[] = {
      {"taken.html", "--report taken.html: cannot be written: Is a directory"},
      {"/proc/none/page.html", "--report /proc/none/page.html: cannot be written: No such file or directory"}};
  for (const auto& [page, says] : cases) {
    const Ended ended = run({"run", kCartPole, "--sim", "--seconds", "1", "--quiet", "--report", page});
    EXPECT_EQ(ended.code, 1) << ended.out;
    EXPECT_TRUE(contains(ended.out, says)) << ended.out;
    EXPECT_FALSE(contains(ended.out, "numpy")) << ended.out;
    EXPECT_FALSE(contains(ended.out, "ended in")) << "nothing was moved: " << ended.out;
  }
  // Python is blamed where it is at fault
  setenv("TILLER_PYTHON", "/nonexistent/python", 1);
  const Ended without = run({"run", kCartPole, "--sim", "--seconds", "0.1", "--quiet", "--report", "page.html"});
  unsetenv("TILLER_PYTHON");
  EXPECT_EQ(without.code, 2) << without.out;
  EXPECT_TRUE(contains(without.out, "tools/dev/requirements.txt")) << without.out;
}

TEST_F(Command, AModelThatIsNotThereIsNamedWithTheOnesThatAre) {
  const std::tuple<const char*, const char*, const char*> cases[] = {
      {"name = \"cart_pol\"", "no built-in model 'cart_pol'; there are: pendulum, cart_pole",
       "did you mean cart_pole?"},
      {"name = \"arm/my_arm.hpp\"", "no built-in model 'arm/my_arm.hpp'",
       "file = \"arm/my_arm.hpp\", type = the name of the"},
      {"name = \"my_arm.c\"", "no built-in model 'my_arm.c'", "[model] file = \"my_arm.c\""},
      {"file = \"pendulum.c\"", "pendulum.c: no such model file", "is built in: [model] name = \"pendulum\""},
      {"file = \"none.c\"", "none.c: no such model file", "relative names start at the robot file's folder"},
  };
  for (const auto& [line, says, remedy] : cases) {
    std::ofstream(folder_ + "/robot.toml") << "[model]\n" << line << "\n";
    const Ended ended = run({"check", "robot.toml"});
    EXPECT_EQ(ended.code, 1);
    EXPECT_TRUE(contains(ended.out, says)) << ended.out;
    EXPECT_TRUE(contains(ended.out, remedy)) << ended.out;
  }
}

TEST_F(Command, AnInadequateModelIsToldOnceAndLeavesItsTicks) {
  // the plant has dry friction, the model has none
  std::ofstream(folder_ + "/rough.toml") << std::ifstream(kCartPole).rdbuf()
                                         << "[[sim.effects]]\nkind = \"coulomb_friction\"\nport = \"cart\"\n"
                                            "friction_SI = 1.5\n";
  const Ended ended = run({"run", "rough.toml", "--sim", "--seconds", "4", "--log", "out.csv", "--alarm-seconds", "3"});
  EXPECT_EQ(ended.code, 0) << "it is news, not the end: " << ended.out;
  int told = 0;
  for (std::size_t at = 0; (at = ended.out.find(" s: the model does not explain ", at)) != std::string::npos; ++at)
    ++told;
  EXPECT_EQ(told, 1) << ended.out;
  EXPECT_TRUE(contains(ended.out, "\n  next: tiller gap rough.toml out.alarm.csv -o out.alarm.report")) << ended.out;
  EXPECT_TRUE(contains(text_of("out.csv"), ",model_inadequate")) << "the status of a tick";
  // 3 s of 20 ms and a header; in lockstep the rows are the log's own
  const std::string rows = first_columns("out.alarm.csv", 4);
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 151);
  EXPECT_EQ(rows.rfind("time_s,position_m,angle_rad,force_N\n", 0), 0u);

  const Ended calm = run({"run", kCartPole, "--sim", "--seconds", "1", "--log", "calm.csv"});
  EXPECT_EQ(calm.code, 0);
  EXPECT_FALSE(fs::exists(folder_ + "/calm.alarm.csv")) << "no alarm, no file";
}

/// The pendulum whose posterior estimates forces, with an effect of the plant that its model lacks.
std::string pendulum_with(const std::string& effect) {
  std::ostringstream text;
  text << std::ifstream(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml").rdbuf()
       << "[posterior]\ndisturbance = true\n[[sim.effects]]\n"
       << effect;
  return text.str();
}

// A force that wanders cannot follow what a late drive leaves: the alarm says what it goes with, and gap on the ticks
// about the alarm names it.
TEST_F(Command, ASystematicForceBesideTheEstimatedOneIsToldAndNamed) {
  std::ofstream(folder_ + "/late.toml") << pendulum_with(
      "kind = \"input_delay\"\nport = \"torque_Nm\"\ndelay_s = 0.06\n");
  // of seeds 1 to 3 gap proves the delay in the ticks of the last two; those of the first have a lag that fits as well
  const Ended ended =
      run({"run", "late.toml", "--sim", "--seconds", "10", "--log", "run.csv", "--quiet", "--seed", "2"});
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out,
                       "beside the force that is estimated, a force at joint 'joint' goes with the input's change "
                       "(a delay, a lag or a wrong gain of the drive); tiller gap names it"))
      << ended.out;
  const Ended gap = run({"gap", "late.toml", "run.alarm.csv", "-o", "report"});
  EXPECT_EQ(gap.code, 1) << gap.out;
  const std::string named = "Missing: input_delay (torque_Nm) (torque_Nm.delay_s = ";
  const std::size_t at = gap.out.find(named);
  ASSERT_NE(at, std::string::npos) << gap.out;
  EXPECT_NEAR(std::strtod(gap.out.c_str() + at + named.size(), nullptr), 0.06, 0.003);
}

// A drag is slow enough for the force that is estimated: gap finds what that goes with, whether the alarm sounds or
// not.
TEST_F(Command, AForceThatTheEstimateTakesUpIsNamedByGap) {
  std::ofstream(folder_ + "/drag.toml") << pendulum_with(
      "kind = \"quadratic_drag\"\nport = \"joint\"\ndrag_SI = 0.05\n");
  const Ended ended = run({"run", "drag.toml", "--sim", "--seconds", "20", "--log", "run.csv", "--quiet"});
  EXPECT_EQ(ended.code, 0) << ended.out;
  const Ended gap = run({"gap", "drag.toml", "run.csv", "-o", "report"});
  EXPECT_EQ(gap.code, 1) << gap.out;
  EXPECT_TRUE(contains(gap.out, "Missing: quadratic_drag (joint)")) << gap.out;
  EXPECT_TRUE(contains(gap.out, "Where: at joint, rate_rad_s from")) << gap.out;
}

// A parameter that may drift: the run says what the data make of it.
TEST_F(Command, ADriftIsToldWithWhatTheDataSayOfIt) {
  std::ofstream(folder_ + "/filled.toml") << std::ifstream(std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml").rdbuf()
                                          << "\n[posterior]\ndrift = [\"mass_kg\"]\n";
  const Ended ended = run({"run", "filled.toml", "--sim", "--seconds", "4", "--quiet"});
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "mass_kg stays: by the data ")) << ended.out;
  EXPECT_TRUE(contains(ended.out, " times likelier than a walk and ")) << ended.out;
}

TEST_F(Command, ExciteProposesWithinLimitsAndTells) {
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  const Words base = {
      "excite",  pendulum,      "--candidates", "input_delay:delay_s=0.02,actuator_lag:time_constant_s=0.02",
      "--keep",  "angle_rad=2", "--limit",      "torque_Nm=1",
      "--tries", "96",          "--seconds",    "4",
      "-o"};
  Words arguments = base;
  arguments.emplace_back("excite.csv");
  const Ended ended = run(arguments);
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "A  input_delay (torque_Nm), torque_Nm.delay_s 0.02")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "then: tiller gap ")) << ended.out;
  const std::string csv = text_of("excite.csv");
  EXPECT_EQ(csv.rfind("time_s,torque_Nm\n", 0), 0u) << csv.substr(0, 100);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 201);  // 4 s of 20 ms, and the header
  std::istringstream rows(csv.substr(csv.find('\n') + 1));
  for (std::string row; std::getline(rows, row);)
    EXPECT_LE(std::fabs(std::strtod(row.substr(row.find(',') + 1).c_str(), nullptr)), 1.0) << row;

  const Ended same = run(
      {"excite", pendulum, "--candidates", "tilt:angle_rad=0.05,sensor_bias:bias_SI=0.05@angle_rad", "-o", "same.csv"});
  EXPECT_EQ(same.code, 1) << same.out;
  const Ended inseparable =
      run({"excite", pendulum, "--candidates", "tilt:angle_rad=0.05,sensor_bias@angle_rad:bias_SI=0.05", "--keep",
           "angle_rad=2", "--tries", "96", "-o", "same.csv"});
  EXPECT_EQ(inseparable.code, 2) << inseparable.out;
  EXPECT_TRUE(contains(inseparable.out, "not by any input; instead: ")) << inseparable.out;

  const struct {
    Words arguments;
    const char* says;
  } wrong[] = {{{"excite", pendulum, "-o", "a.csv"}, "no candidates: --gap"},
               {{"excite", pendulum, "--candidates", "tilt", "-o", "a.csv"}, "name two or more"},
               {{"excite", pendulum, "--candidates", "tilt,tilt", "-o", "a.csv"}, "twice"},
               {{"excite", pendulum, "--candidates", "tilt,payload", "--limit", "torque_Nm=99", "-o", "a.csv"},
                "wider than [limits]"},
               {{"excite", pendulum, "--candidates", "tilt,payload", "--keep", "angel_rad=1", "-o", "a.csv"},
                "name one of angle_rad, rate_rad_s"},
               {{"excite", pendulum, "--gap", "none.json", "-o", "a.csv"}, "none.json: cannot be read"}};
  for (const auto& w : wrong) {
    const Ended refused = run(w.arguments);
    EXPECT_EQ(refused.code, 1) << refused.out;
    EXPECT_TRUE(contains(refused.out, w.says)) << "expected '" << w.says << "' in\n" << refused.out;
  }
}

TEST_F(Command, IdentifyRefusesOptionsThatTheMethodDoesNotRead) {
  const struct {
    Words options;
    const char* says;
  } wrong[] = {
      {{"--eta", "2"}, "--eta 2: the method posterior does not read it; leave it out, or choose --method reps"},
      {{"--method", "reps", "--eta", "1", "--kl", "2"}, "--eta 1, --kl 2: both set the temperature of reps"},
      {{"--method", "reps", "--l1", "1"}, "--l1 1: the method reps does not read it"},
      {{"--method", "simopt", "--rollout", "1"}, "choose --method trajectory_simopt"},
      {{"--method", "abc", "--scale"}, "--scale: the method abc does not read it"},
      {{"--method", "abc", "--no-scale"}, "--no-scale: the method abc does not read it"},
      {{"--method", "simopt", "--discrepancy", "wasserstein", "--l2", "3"}, "--l2 3: --discrepancy wasserstein"},
      {{"--method", "simopt", "--discrepancy", "emd"}, "emd"},
      {{"--method", "reps", "--eta", "0"}, "not a number within"},
      {{"--method", "step_simopt"}, "there is no method 'step_simopt'; known are posterior, reps, simopt"}};
  for (const auto& w : wrong) {
    Words arguments = {"identify", kCartPole, "log.csv"};
    arguments.insert(arguments.end(), w.options.begin(), w.options.end());
    const Ended refused = run(arguments);
    EXPECT_EQ(refused.code, 1) << refused.out;
    EXPECT_TRUE(contains(refused.out, w.says)) << "expected '" << w.says << "' in\n" << refused.out;
  }
}

// What is left out is the method's own, not false and not zero.
TEST_F(Command, FormsOfADiscrepancyThatAreNotGivenAreTheMethods) {
  if (std::string why; !tiller::tools::laboratory_is_ready(why)) GTEST_SKIP() << why;
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  ASSERT_EQ(run({"run", pendulum, "--sim", "--seconds", "3", "--quiet", "--log", "p.csv"}).code, 0);
  const auto table = [&](const Words& options) {
    Words arguments = {"identify", pendulum, "p.csv", "--simulations", "400", "--iterations", "2", "--method"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Ended ended = run(arguments);
    EXPECT_EQ(ended.code, 0) << ended.out;
    const std::size_t from = ended.out.find("damping_Nms");
    return from == std::string::npos ? ended.out : ended.out.substr(from);
  };
  const std::string steps = table({"simopt"}), trajectories = table({"trajectory_simopt"}),
                    distances = table({"simopt", "--discrepancy", "wasserstein"});
  EXPECT_EQ(table({"simopt", "--l1", "0", "--l2", "1", "--no-scale"}), steps);
  EXPECT_NE(table({"simopt", "--scale"}), steps);
  EXPECT_EQ(table({"trajectory_simopt", "--l1", "1", "--l2", "1", "--scale"}), trajectories);
  EXPECT_NE(table({"trajectory_simopt", "--no-scale"}), trajectories);
  EXPECT_EQ(table({"simopt", "--discrepancy", "wasserstein", "--scale"}), distances);
  EXPECT_NE(table({"simopt", "--discrepancy", "wasserstein", "--no-scale"}), distances);
}

TEST_F(Command, EpisodesAreRefittedByAMethod) {
  if (std::string why; !tiller::tools::laboratory_is_ready(why)) GTEST_SKIP() << why;
  const Words series = {"run",        kCartPole,  "--sim",       "--quiet",         "--seconds",
                        "1",          "--method", "simopt",      "--simulations",   "1000",
                        "--episodes", "2",        "--posterior", "kept/simopt.json"};
  const Ended first = run(series);
  ASSERT_EQ(first.code, 0) << first.out;
  EXPECT_TRUE(contains(first.out, "episode 2: cost ")) << first.out;
  EXPECT_TRUE(contains(first.out, "; discrepancy ")) << first.out;
  EXPECT_TRUE(contains(text_of("kept/simopt.json"), "\"episodes\": 2")) << text_of("kept/simopt.json");
  EXPECT_TRUE(contains(run(series).out, "kept/simopt.json: posterior of 2 episode(s), "));

  const struct {
    Words options;
    const char* says;
  } wrong[] = {
      {{"--method", "abc"}, "there is no method 'abc'; known are posterior, simopt, trajectory_simopt, reps"},
      {{"--method", "simopt", "--frozen"}, "--frozen, --method simopt: the one keeps the prior"},
      {{"--method", "reps", "--l1", "1"},
       "--l1 1: the method reps does not read it; leave it out, or choose --method "
       "simopt or trajectory_simopt"},
      {{"--kl", "1"}, "--kl 1: the method posterior does not read it; leave it out, or choose --method reps or simopt"},
      {{"--online"}, "--online: the method posterior learns within the episodes anyway"},
      {{"--method", "simopt", "--episodes", "1"}, "nothing would read the refitted prior; give --episodes"}};
  for (const auto& w : wrong) {
    Words arguments = {"run", kCartPole, "--sim", "--seconds", "1"};
    arguments.insert(arguments.end(), w.options.begin(), w.options.end());
    const Ended refused = run(arguments);
    EXPECT_EQ(refused.code, 1) << refused.out;
    EXPECT_TRUE(contains(refused.out, w.says)) << "expected '" << w.says << "' in\n" << refused.out;
  }
  const Ended endless = run({"run", kCartPole, "--sim", "--episodes", "2", "--method", "simopt"});
  EXPECT_EQ(endless.code, 1);
  EXPECT_TRUE(contains(endless.out, "--method simopt: give each episode a length with --seconds")) << endless.out;
}

// Its noise scale and exponent are not known: the file says 1, and not what no reader takes.
TEST_F(Command, WhatAMethodLearnsIsAPriorToo) {
  if (std::string why; !tiller::tools::laboratory_is_ready(why)) GTEST_SKIP() << why;
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  ASSERT_EQ(run({"run", pendulum, "--sim", "--seconds", "3", "--quiet", "--log", "p.csv"}).code, 0);
  const Ended fitted = run(
      {"identify", pendulum, "p.csv", "--method", "simopt", "--simulations", "400", "--iterations", "2", "-o", "fit"});
  EXPECT_TRUE(contains(fitted.out, "posterior: ")) << fitted.out;
  EXPECT_TRUE(contains(text_of("fit/posterior.json"), "\"noise_scale\": 1")) << text_of("fit/posterior.json");
  const Ended used =
      run({"run", pendulum, "--sim", "--seconds", "0.5", "--quiet", "--posterior", "fit/posterior.json"});
  EXPECT_EQ(used.code, 0) << used.out;
}

TEST_F(Command, EpisodesGoOnFromTheirFile) {
  const Words series = {"run",        kCartPole, "--sim",       "--quiet",        "--seconds", "1",
                        "--episodes", "2",       "--posterior", "kept/cart.json", "--record",  "run.rec"};
  const Ended first = run(series);
  ASSERT_EQ(first.code, 0) << first.out;
  EXPECT_TRUE(contains(first.out, "kept/cart.json: not there yet")) << first.out;
  EXPECT_TRUE(contains(first.out, "episode 2: cost ")) << first.out;
  const Ended second = run(series);
  ASSERT_EQ(second.code, 0) << second.out;
  EXPECT_TRUE(contains(second.out, "posterior of 2 episode(s), ")) << second.out;
  EXPECT_TRUE(contains(second.out, "episode 4: cost ")) << second.out;
  EXPECT_TRUE(contains(text_of("kept/cart.json"), "\"episodes\": 4")) << text_of("kept/cart.json");
  // the joint prior is in the record: the robot file knows nothing of it
  const Ended replayed = run({"replay", "run-4.rec", kCartPole});
  EXPECT_EQ(replayed.code, 0) << replayed.out;
  EXPECT_TRUE(contains(replayed.out, ", 0 different")) << replayed.out;

  const Ended endless = run({"run", kCartPole, "--sim", "--episodes", "2"});
  EXPECT_EQ(endless.code, 1);
  EXPECT_TRUE(contains(endless.out, "--episodes: give each a length with --seconds")) << endless.out;
  const Ended frozen = run({"run", kCartPole, "--sim", "--seconds", "1", "--frozen", "--posterior", "kept/cart.json"});
  EXPECT_EQ(frozen.code, 1);
  EXPECT_TRUE(contains(frozen.out, "nothing is learnt")) << frozen.out;
  const std::string pendulum = std::string(TILLER_TEST_ROBOTS) + "/pendulum.toml";
  const Ended other = run({"run", pendulum, "--sim", "--seconds", "1", "--posterior", "kept/cart.json"});
  EXPECT_EQ(other.code, 1);
  EXPECT_TRUE(contains(other.out, "model = \"cart_pole\": the robot file's model is pendulum")) << other.out;
}

TEST_F(Command, DemoEndsUprightWithItsLog) {
  const Ended ended = run({"demo", "--fast", "--no-report", "--seconds", "8", "--out", "made/here"});
  EXPECT_EQ(ended.code, 0) << ended.out;
  EXPECT_TRUE(contains(ended.out, "\nUPRIGHT: ")) << ended.out;
  EXPECT_TRUE(contains(ended.out, "pole_mass_kg")) << ended.out;
  EXPECT_TRUE(fs::exists(folder_ + "/made/here/demo.csv"));
}

TEST_F(Command, DemoWhereNoFolderCanBeMade) {
  setenv("TMPDIR", folder_.c_str(), 1);
  const Ended ended = run({"demo", "--fast", "--no-report", "--seconds", "0.5", "--out", "/proc/none"});
  unsetenv("TMPDIR");
  EXPECT_EQ(ended.code, 2) << ended.out;
  EXPECT_TRUE(contains(ended.out, "/proc/none: files cannot be made there")) << ended.out;
}

}  // namespace
