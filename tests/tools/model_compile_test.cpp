// A model's compiler as a user meets it: one for all commands that want the model, told of, and never left behind.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <thread>

#include "command_rig.hpp"

namespace {

using namespace tiller::test;

/// A command that wants the model. Each writes a file of its own: two that write the same one at once are refused.
Words wants_model(const std::string& file = "config.c") { return {"export", TILLER_TEST_C_ROBOT, "-o", file}; }

/// Becomes true, or the test is at its end: nothing here depends on how long it takes.
bool eventually(const std::function<bool()>& holds) {
  for (int i = 0; i < 1200; ++i) {
    if (holds()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

/// A process that is there and not only waiting for its parent to note its end.
bool is_running(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string text;
  std::getline(file, text);
  const std::size_t name_end = text.rfind(')');
  return name_end != std::string::npos && text[name_end + 2] != 'Z' && text[name_end + 2] != 'X';
}

/// In the compiler's place a script that has a child, as drivers have, and waits until the file `go` is there.
class ModelCompile : public Command {
 protected:
  void SetUp() override {
    Command::SetUp();
    std::ofstream(folder_ + "/cc.sh") << R"(#!/bin/sh
echo started >> runs
sh -c '[ -e stubborn ] && trap "" TERM; echo $$ > pass.pid; while :; do sleep 1; done' &
pass=$!
[ -e stubborn ] && trap "" TERM
echo $$ > driver.pid
while [ ! -e go ]; do sleep 0.1; done
kill -KILL $pass
exec cc "$@"
)";
    fs::permissions(folder_ + "/cc.sh", fs::perms::owner_all);
    setenv("TILLER_CC", (folder_ + "/cc.sh").c_str(), 1);
    setenv("TILLER_CACHE", (folder_ + "/cache").c_str(), 1);
  }

  pid_t start_compiling(const std::string& output = "out.txt") {
    const pid_t command = start(wants_model(), output);
    EXPECT_TRUE(eventually([&] { return pid_in("driver.pid") > 0 && pid_in("pass.pid") > 0; })) << text_of(output);
    return command;
  }
  pid_t pid_in(const std::string& file) const { return static_cast<pid_t>(std::atoi(text_of(file).c_str())); }
  void touch(const std::string& name) const { std::ofstream(folder_ + "/" + name) << "\n"; }
  void expect_no_compiler_left() const {
    for (const char* file : {"driver.pid", "pass.pid"})
      EXPECT_TRUE(eventually([&] { return !is_running(pid_in(file)); })) << file << " is left";
  }
  long runs() const {
    const std::string text = text_of("runs");
    return std::count(text.begin(), text.end(), '\n');
  }
};

TEST_F(ModelCompile, TheCompilerEndsWithTheCommandHoweverThatEnds) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGKILL}) {
    const pid_t command = start_compiling();
    kill(command, signal);
    EXPECT_EQ(finish(command).code, 128 + signal);
    expect_no_compiler_left();
    for (const char* file : {"driver.pid", "pass.pid"}) fs::remove(folder_ + "/" + file);
  }
}

TEST_F(ModelCompile, SoDoesOneThatDoesNotListen) {
  touch("stubborn");
  for (const int signal : {SIGTERM, SIGKILL}) {
    const pid_t command = start_compiling();
    kill(command, signal);
    EXPECT_EQ(finish(command).code, 128 + signal);
    expect_no_compiler_left();
    for (const char* file : {"driver.pid", "pass.pid"}) fs::remove(folder_ + "/" + file);
  }
}

TEST_F(ModelCompile, ParallelCommandsShareOneCompilation) {
  const pid_t first = start_compiling("first.txt");
  const pid_t second = start(wants_model("second.c"), "second.txt");
  const pid_t third = start(wants_model("third.c"), "third.txt");
  for (const char* output : {"second.txt", "third.txt"})
    EXPECT_TRUE(
        eventually([&] { return contains(text_of(output), "waiting for another tiller that compiles model"); }));
  EXPECT_TRUE(eventually([&] { return contains(text_of("first.txt"), "s so far"); })) << "no progress is told";
  EXPECT_TRUE(eventually([&] { return contains(text_of("second.txt"), "s so far"); })) << "nor by who waits";
  touch("go");
  EXPECT_EQ(finish(first, "first.txt").code, 0) << text_of("first.txt");
  EXPECT_EQ(finish(second, "second.txt").code, 0) << text_of("second.txt");
  EXPECT_EQ(finish(third, "third.txt").code, 0) << text_of("third.txt");
  EXPECT_EQ(runs(), 1);
  EXPECT_TRUE(contains(text_of("first.txt"), ": done after "));
  EXPECT_EQ(run(wants_model()).code, 0);
  EXPECT_EQ(runs(), 1) << "the copy serves";
}

TEST_F(ModelCompile, WhoWaitsGoesOnWhereTheFirstWasKilled) {
  const pid_t first = start_compiling("first.txt");
  const pid_t second = start(wants_model("second.c"), "second.txt");
  EXPECT_TRUE(eventually([&] { return contains(text_of("second.txt"), "waiting for another tiller"); }));
  touch("go");
  kill(first, SIGKILL);
  finish(first, "first.txt");
  EXPECT_EQ(finish(second, "second.txt").code, 0) << text_of("second.txt");
}

// As on a machine that has the command's package, and not that of the headers.
TEST_F(ModelCompile, MissingHeadersNameTheirPackage) {
  std::ofstream(folder_ + "/cc.sh") << R"(#!/bin/sh
echo 'm.cpp:1:10: fatal error: rollout/export_model.hpp: No such file or directory' >&2
exit 1
)";
  const Ended ended = run(wants_model());
  EXPECT_NE(ended.code, 0);
  EXPECT_TRUE(contains(ended.out, "install the package libtiller-dev, or set TILLER_INCLUDE")) << ended.out;
}

}  // namespace
