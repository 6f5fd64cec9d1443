#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace tiller::test {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

struct Ended {
  int code = -1;
  std::string out;  // stdout and stderr
};

/// The tiller program (TILLER_TEST_COMMAND) in a folder of its own that goes with the test.
class Command : public testing::Test {
 protected:
  void SetUp() override {
    std::string made = (fs::temp_directory_path() / "tiller-command-XXXXXX").string();
    ASSERT_NE(mkdtemp(made.data()), nullptr);
    folder_ = made;
  }
  void TearDown() override { fs::remove_all(folder_); }

  pid_t start(const Words& arguments, const std::string& output = "out.txt") {
    const pid_t child = fork();
    if (child != 0) return child;
    // a job in the background of a shell, or under nohup, has them ignored, and would hand that on
    for (const int told : {SIGINT, SIGTERM, SIGHUP}) std::signal(told, SIG_DFL);
    if (chdir(folder_.c_str()) != 0) _exit(126);
    const int out = open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    std::vector<char*> argv = {const_cast<char*>(TILLER_TEST_COMMAND)};
    for (const std::string& word : arguments) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    execv(TILLER_TEST_COMMAND, argv.data());
    _exit(127);
  }

  Ended finish(pid_t child, const std::string& output = "out.txt") {
    int status = 0;
    waitpid(child, &status, 0);
    Ended ended;
    ended.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    ended.out = text_of(output);
    return ended;
  }

  Ended run(const Words& arguments) {
    const Ended ended = finish(start(arguments));
    std::printf("$ tiller");
    for (const std::string& word : arguments) std::printf(" %s", word.c_str());
    std::printf("   -> %d\n", ended.code);
    return ended;
  }

  std::string text_of(const std::string& name) const {
    std::ifstream file(folder_ + "/" + name, std::ios::binary);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
  }

  /// Columns 0..n of every row of a CSV: time, measurements and command, without the tick times behind them.
  std::string first_columns(const std::string& name, int columns) const {
    std::istringstream rows(text_of(name));
    std::string kept;
    for (std::string row; std::getline(rows, row);) {
      std::size_t end = 0;
      for (int i = 0; i < columns && end != std::string::npos; ++i) end = row.find(',', end + 1);
      kept += row.substr(0, end) + "\n";
    }
    return kept;
  }

  std::string folder_;
};

inline bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace tiller::test
