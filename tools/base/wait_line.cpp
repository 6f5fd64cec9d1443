#include "tools/base/wait_line.hpp"

#include <unistd.h>

#include <cstdio>

namespace tiller::tools {

WaitLine::WaitLine(std::string what) : what_(std::move(what)), terminal_(isatty(STDERR_FILENO) != 0) {
  std::fprintf(stderr, "tiller: %s ...%s", what_.c_str(), terminal_ ? "" : "\n");
  std::fflush(stderr);
}

void WaitLine::show(int seconds) {
  if (terminal_)
    std::fprintf(stderr, "\rtiller: %s ... %d s so far", what_.c_str(), seconds);
  else if (seconds == 2 || seconds % 10 == 0)
    std::fprintf(stderr, "tiller: %s, %d s so far\n", what_.c_str(), seconds);
  std::fflush(stderr);
}

void WaitLine::end(const std::string& outcome, int seconds) {
  if (terminal_)
    std::fprintf(stderr, "\r\033[Ktiller: %s: %s after %d s\n", what_.c_str(), outcome.c_str(), seconds);
  else
    std::fprintf(stderr, "tiller: %s: %s after %d s\n", what_.c_str(), outcome.c_str(), seconds);
}

}  // namespace tiller::tools
