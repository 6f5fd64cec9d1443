#pragma once

#include <functional>
#include <string>

namespace tiller::tools {

/// How a copy of this process ended.
struct CopyResult {
  bool started = false;
  int signal = 0;      ///< that ended it; SIGXCPU: its processor time was over, SIGALRM: it waits for something
  std::string answer;  ///< what `work` returned
};

/// Runs `work` in a copy of this process (fork) and waits for it: a fault, an endless loop or a number written to a
/// wrong place harms the copy alone. `work` starts no threads and waits for none.
CopyResult run_in_copy(const std::function<std::string()>& work, unsigned most_cpu_seconds);

}  // namespace tiller::tools
