#include "tools/base/progress_line.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace tiller::tools {
namespace {

constexpr double kFirst_s = 2.0, kTerminal_s = 0.2, kElsewhere_s = 10.0;

}  // namespace

ProgressLine::ProgressLine(std::string what)
    : what_(std::move(what)),
      terminal_(isatty(STDERR_FILENO) != 0),
      started_(Clock::now()),
      next_s_(terminal_ ? kTerminal_s : kFirst_s) {}

ProgressLine::~ProgressLine() {
  if (shown_ && terminal_) std::fprintf(stderr, "\r\033[K");
}

void ProgressLine::show(double share) {
  const std::lock_guard<std::mutex> lock(mutex_);
  share_ = std::clamp(share, share_, 1.0);
  const double so_far_s = std::chrono::duration<double>(Clock::now() - started_).count();
  if (so_far_s < next_s_) return;
  next_s_ = so_far_s + (terminal_ ? kTerminal_s : kElsewhere_s);
  shown_ = true;
  std::fprintf(stderr, "%s%s: %2.0f %%, %.0f s", terminal_ ? "\r\033[K" : "tiller: ", what_.c_str(), 100 * share_,
               so_far_s);
  if (share_ > 0.02) std::fprintf(stderr, ", about %.0f s left", so_far_s * (1 / share_ - 1));
  std::fprintf(stderr, "%s", terminal_ ? "" : "\n");
  std::fflush(stderr);
}

}  // namespace tiller::tools
