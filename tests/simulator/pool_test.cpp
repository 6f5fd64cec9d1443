// Simulators that answer, die, hang, speak nonsense and disagree about counts: real processes over real pipes.

#include "tools/simulator/simulator_pool.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace tiller::tools {
namespace {

/// A simulator whose body sets `rows` from p (its parameter), start, inputs; `before` stands in front of the greeting.
std::string script(const std::string& body, const std::string& before = "") {
  return "import json, os, sys, time\n" + before +
         "\nsys.stdin.readline()\nprint('{\"tiller_simulator\": 1}', flush=True)\n"
         "for line in sys.stdin:\n"
         "    ask = json.loads(line)\n"
         "    p, rows = ask['parameters'][0], []\n"
         "    x = ask['start'][0]\n"
         "    for u in ask['inputs']:\n"
         "        x += p * u[0]\n"
         "        rows.append([x])\n" +
         body + "\n    print(json.dumps({'id': ask['id'], 'measured': rows}), flush=True)\n";
}

SimulatorSetup setup_of(const std::string& program) {
  SimulatorSetup setup;
  setup.command = {TEST_PYTHON, "-c", program};
  setup.names = {{"gain"}, {"force_N"}, {"position_m"}, 0.01};
  return setup;
}

std::vector<SimulationRequest> requests(int count) {
  std::vector<SimulationRequest> all;
  for (int i = 0; i < count; ++i) all.push_back({{static_cast<double>(i)}, {0.5}, {1.0, 2.0, 3.0}, 1, 3});
  return all;
}

struct Outcome {
  bool good = false;
  std::vector<SimulationAnswer> answers;
  std::string error;
  unsigned restarts = 0;
};

/// However it ends, no process is left behind, not even a dead one.
Outcome run(const SimulatorSetup& setup, int count) {
  Outcome out;
  {
    SimulatorPool pool(setup);
    out.good = pool.run(requests(count), out.answers, out.error);
    out.restarts = pool.restarts();
  }
  errno = 0;
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
  return out;
}

/// Dead, and waiting for whoever inherited it.
bool is_zombie(int process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string text;
  std::getline(file, text);
  const std::size_t end = text.rfind(") ");
  return end != std::string::npos && text.substr(end + 2, 1) == "Z";
}

void expect_right(const SimulationAnswer& answer, int i) {
  ASSERT_EQ(answer.measured.size(), 3u) << i << " " << answer.failure;
  EXPECT_DOUBLE_EQ(answer.measured[2], 0.5 + 6.0 * i);
}

TEST(SimulatorPool, AnswersInTheOrderOfRequestsWhateverTheNumberOfProcesses) {
  SimulatorSetup setup = setup_of(script("    time.sleep(0.002 * (ask['id'] % 3))"));
  for (const unsigned processes : {1u, 3u}) {
    setup.processes = processes;
    const Outcome out = run(setup, 20);
    ASSERT_TRUE(out.good) << out.error;
    for (int i = 0; i < 20; ++i) expect_right(out.answers[static_cast<std::size_t>(i)], i);
  }
}

TEST(SimulatorPool, GoesOnBehindADrawThatKills) {
  const Outcome out = run(setup_of(script("    if p == 3:\n        sys.stderr.write('singular\\n')\n        "
                                          "sys.stderr.flush(); os._exit(9)")),
                          8);
  ASSERT_TRUE(out.good) << out.error;
  EXPECT_EQ(out.restarts, 1u);
  for (int i = 0; i < 8; ++i)
    if (i != 3) expect_right(out.answers[static_cast<std::size_t>(i)], i);
  EXPECT_TRUE(out.answers[3].measured.empty());
  EXPECT_NE(out.answers[3].failure.find("exit code 9: singular"), std::string::npos) << out.answers[3].failure;
}

TEST(SimulatorPool, TellsASignal) {
  const Outcome out = run(setup_of(script("    if p == 1: os.abort()")), 3);
  ASSERT_TRUE(out.good) << out.error;
  EXPECT_NE(out.answers[1].failure.find("signal 6"), std::string::npos) << out.answers[1].failure;
  expect_right(out.answers[2], 2);
}

TEST(SimulatorPool, KillsOneThatHangs) {
  SimulatorSetup setup = setup_of(script("    if p == 2: time.sleep(1000)"));
  setup.timeout_s = 0.5;
  const Outcome out = run(setup, 5);
  ASSERT_TRUE(out.good) << out.error;
  EXPECT_NE(out.answers[2].failure.find("did not answer within 0.5 s"), std::string::npos) << out.answers[2].failure;
  for (const int i : {0, 1, 3, 4}) expect_right(out.answers[static_cast<std::size_t>(i)], i);
}

TEST(SimulatorPool, StopsWhenItsRestartsAreUsedUp) {
  SimulatorSetup setup = setup_of(script("    os._exit(4)"));
  setup.restarts = 2;
  const Outcome out = run(setup, 30);
  EXPECT_FALSE(out.good);
  EXPECT_EQ(out.restarts, 3u);
  EXPECT_NE(out.error.find("after 2 restarts the simulator ended with exit code 4 again, this time at gain = 2"),
            std::string::npos)
      << out.error;
}

TEST(SimulatorPool, EndsWhereOneDiesBetweenRequestsForEver) {
  SimulatorSetup setup = setup_of("print('{\"tiller_simulator\": 1}', flush=True)\n");
  setup.restarts = 2;
  const Outcome out = run(setup, 3);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("after 2 restarts"), std::string::npos) << out.error;
}

TEST(SimulatorPool, ShowsALineThatIsNoAnswer) {
  const Outcome out = run(setup_of(script("    print('step 1 of 3', flush=True)")), 2);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("'step 1 of 3': is no JSON object"), std::string::npos) << out.error;
}

TEST(SimulatorPool, RefusesAWrongCount) {
  const Outcome out = run(setup_of(script("    rows.append([0.0])")), 2);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("has 4 rows, and 3 inputs were sent"), std::string::npos) << out.error;
}

TEST(SimulatorPool, CountsNaNAsAFailure) {
  const Outcome out = run(setup_of(script("    if p == 1: rows[1][0] = float('nan')")), 3);
  ASSERT_TRUE(out.good) << out.error;
  EXPECT_EQ(out.answers[1].failure, "not finite from period 2 on");
  expect_right(out.answers[2], 2);
}

TEST(SimulatorPool, TellsWhyOneDoesNotStart) {
  SimulatorSetup setup = setup_of(script("", "raise SystemExit('no licence')"));
  Outcome out = run(setup, 1);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("before it had greeted"), std::string::npos) << out.error;
  EXPECT_NE(out.error.find("no licence"), std::string::npos) << out.error;
  setup.command = {"/no/such/simulator"};
  out = run(setup, 1);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("cannot start /no/such/simulator"), std::string::npos) << out.error;
}

TEST(SimulatorPool, TellsWhatToDoAboutAFileThatIsNotExecutable) {
  std::string folder = (std::filesystem::temp_directory_path() / "tiller-pool-XXXXXX").string();
  ASSERT_NE(mkdtemp(folder.data()), nullptr);
  std::ofstream(folder + "/box.py") << "print('no')\n";
  SimulatorSetup setup = setup_of("");
  setup.command = {"./box.py"};
  setup.folder = folder;
  const Outcome out = run(setup, 2);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("cannot start ./box.py in " + folder + ": Permission denied; make it executable"),
            std::string::npos)
      << out.error;
  std::filesystem::remove_all(folder);
}

TEST(SimulatorPool, TellsWhatToDoAboutOneThatEndsAtOnce) {
  SimulatorSetup setup = setup_of("");
  setup.command = {"true"};
  const Outcome out = run(setup, 2);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("ended with exit code 0 before it had greeted; run its command by hand"), std::string::npos)
      << out.error;
}

// Half a line of the dead one must not become the beginning of the next one's.
TEST(SimulatorPool, ForgetsTheHalfLineOfOneThatDies) {
  const Outcome out = run(setup_of(script("    if p == 2:\n        sys.stdout.write('{\"id\": 3, \"meas')\n        "
                                          "sys.stdout.flush(); os._exit(1)")),
                          6);
  ASSERT_TRUE(out.good) << out.error;
  EXPECT_NE(out.answers[2].failure.find("exit code 1"), std::string::npos) << out.answers[2].failure;
  for (const int i : {0, 1, 3, 4, 5}) expect_right(out.answers[static_cast<std::size_t>(i)], i);
}

// What went to stderr is shown with the line that is wrong, its end if it is long.
TEST(SimulatorPool, ShowsTheEndOfStderrWithAWrongLine) {
  const Outcome out = run(setup_of(script("    if p == 1:\n        sys.stderr.write('x' * 5000 + ' no gravity\\n')\n"
                                          "        sys.stderr.flush(); time.sleep(0.1); rows = [[1, 2]] * 3")),
                          3);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("row 1 of \"measured\" is no list of 1 numbers"), std::string::npos) << out.error;
  EXPECT_NE(out.error.find("x no gravity"), std::string::npos) << out.error;
  EXPECT_LT(out.error.size(), 3000u);
}

// A wrapper's own children hold the pipes open; they go with it.
TEST(SimulatorPool, KillsTheChildrenOfOneThatHangs) {
  SimulatorSetup setup = setup_of(
      script("    import subprocess\n    child = subprocess.Popen(['sleep', '1000'])\n    sys.stderr.write('%d\\n' % "
             "child.pid)\n    sys.stderr.flush(); time.sleep(1000)"));
  setup.timeout_s = 2.0;  // Python loads a module first
  setup.restarts = 0;
  const Outcome out = run(setup, 1);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("raise timeout_s or restarts"), std::string::npos) << out.error;
  const std::string mark = "stderr: ";
  const std::size_t at = out.error.find(mark);
  ASSERT_NE(at, std::string::npos) << out.error;
  const int child = std::atoi(out.error.c_str() + at + mark.size());
  ASSERT_GT(child, 1);
  int tries = 0;  // it is killed at once, and reaped by whoever inherits it
  for (; tries < 100 && ::kill(child, 0) == 0 && !is_zombie(child); ++tries) usleep(20000);
  EXPECT_LT(tries, 100);
}

TEST(SimulatorPool, WaitsForTheGreetingNoLongerThanItsTime) {
  SimulatorSetup setup = setup_of(script("", "time.sleep(1000)"));
  setup.start_s = 0.3;
  const Outcome out = run(setup, 1);
  EXPECT_FALSE(out.good);
  EXPECT_NE(out.error.find("did not answer within 0.3 s before it had greeted; raise start_s"), std::string::npos)
      << out.error;
}

// Longer than what a pipe holds, in both directions: whoever writes without reading would stand still for ever.
TEST(SimulatorPool, TakesLinesLongerThanAPipe) {
  SimulatorSetup setup = setup_of(script("    sys.stderr.write('x' * 100000)"));
  setup.ahead = 4;
  SimulatorPool pool(setup);
  std::vector<SimulationRequest> all(6, {{0.0}, {0.5}, std::vector<double>(20000, 1.25), 1, 20000});
  std::vector<SimulationAnswer> answers;
  std::string error;
  ASSERT_TRUE(pool.run(all, answers, error)) << error;
  for (const SimulationAnswer& answer : answers) EXPECT_EQ(answer.measured.size(), 20000u);
}

/// The first block of the page's code that a fence of this kind opens.
std::string block_of(const std::string& page, const std::string& kind) {
  const std::size_t from = page.find("```" + kind + "\n");
  if (from == std::string::npos) return "";
  const std::size_t begin = from + kind.size() + 4;
  return page.substr(begin, page.find("```", begin) - begin);
}

// A puck of 0.5 kg, friction p: what a few lines here say of it.
double puck_at(double friction, const std::vector<double>& force_N, double period_s) {
  double x = 0.0, v = 0.0;
  for (const double force : force_N)
    for (int i = 0; i < 10; ++i) {
      const double h = 0.1 * period_s, free = v + h * force / 0.5, grip = h * friction * 9.81;
      v = std::fabs(free) <= grip ? 0.0 : free - std::copysign(grip, free);
      x += h * v;
    }
  return x;
}

TEST(SimulatorPool, RunsTheExampleOfTheGuide) {
  std::ifstream file(TEST_GUIDE);
  std::stringstream text;
  text << file.rdbuf();
  const std::string example = block_of(text.str(), "python");
  ASSERT_FALSE(example.empty());
  SimulatorSetup setup;
  setup.command = {TEST_PYTHON, "-c", example};
  setup.names = {{"friction"}, {"force_N"}, {"position_m"}, 0.02};
  SimulatorPool pool(setup);
  const std::vector<double> force_N = {20.0, 20.0, 0.0, 0.0, 0.0, -5.0};
  std::vector<SimulationAnswer> answers;
  std::string error;
  ASSERT_TRUE(pool.run({{{0.3}, {0.0}, force_N, 1, 6}}, answers, error)) << error;
  ASSERT_EQ(answers[0].measured.size(), 6u) << answers[0].failure;
  EXPECT_NEAR(answers[0].measured[5], puck_at(0.3, force_N, 0.02), 1e-12);
}

}  // namespace
}  // namespace tiller::tools
