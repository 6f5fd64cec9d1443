#pragma once

#include <functional>
#include <string>
#include <vector>

namespace tiller::tools {

/// How a child process ended, with what it wrote to stdout and stderr together.
struct ChildResult {
  bool started = false;
  int exit_code = -1;
  std::string output;
};

/// Runs argv[0] (looked up in PATH) without a shell, so that no character of a file name is special, and waits for it.
/// `each_second` is told the seconds so far. The child and its own children are one process group that ends with this
/// process: SIGINT, SIGTERM and SIGHUP end the group before they take their course here, and where this process is
/// killed, a second one that waits for that ends the group.
ChildResult run_child(const std::vector<std::string>& argv, const std::function<void(int seconds)>& each_second = {});

}  // namespace tiller::tools
