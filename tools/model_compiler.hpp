#pragma once

#include <string>
#include <vector>

namespace tiller::tools {

/// How a child process ended, with what it wrote to stdout and stderr together.
struct ChildResult {
  bool started = false;
  int exit_code = -1;
  std::string output;
};

/// Runs argv[0] (looked up in PATH) without a shell, so that no character of a file name is special.
ChildResult run_child(const std::vector<std::string>& argv);

/// Compiles a model source into a shared object that exports `tiller_model`, or finds it in the cache.
/// `path` is absolute and exists; `type` is the struct's name for ".hpp" and "" for ".c", `cost_type` the cost
/// template's or "". Returns the shared
/// object's path, or "" with `error` set. Prints one line to stderr when it compiles.
std::string compile_model(const std::string& path, const std::string& type, const std::string& cost_type,
                          std::string& error);

}  // namespace tiller::tools
