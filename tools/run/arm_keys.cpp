#include "tools/run/arm_keys.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>

namespace tiller::tools {
namespace {

/// Of a terminal, and in its foreground: whoever reads or sets it from the background is stopped.
bool has_terminal() { return isatty(STDIN_FILENO) != 0 && tcgetpgrp(STDIN_FILENO) == getpgrp(); }

}  // namespace

ArmRequest decide(const char* typed, std::size_t count) {
  if (count == 1 && *typed == 'a') return ArmRequest::arm;
  const bool escaped = count > 0 && *typed == '\033';
  const bool stops = std::any_of(typed, typed + count, [](char c) { return c == 'd' || c == ' '; });
  return stops && !escaped ? ArmRequest::disarm : ArmRequest::none;
}

ArmKeys::ArmKeys() {
  if (!has_terminal() || tcgetattr(STDIN_FILENO, &before_) != 0) return;
  termios keys = before_;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  keys.c_cc[VMIN] = 0;
  keys.c_cc[VTIME] = 0;
  // what was typed before now meant something else
  is_set_ = tcsetattr(STDIN_FILENO, TCSAFLUSH, &keys) == 0;
}

ArmKeys::~ArmKeys() {
  if (is_set_ && has_terminal()) (void)tcsetattr(STDIN_FILENO, TCSAFLUSH, &before_);
}

ArmRequest ArmKeys::poll() {
  if (!is_set_ || !has_terminal()) return ArmRequest::none;
  pollfd in = {STDIN_FILENO, POLLIN, 0};
  if (::poll(&in, 1, 0) != 1 || (in.revents & POLLIN) == 0) return ArmRequest::none;
  char typed[256];
  const ssize_t count = ::read(STDIN_FILENO, typed, sizeof typed);
  return count > 0 ? decide(typed, static_cast<std::size_t>(count)) : ArmRequest::none;
}

std::string ArmKeys::help() const { return is_set_ ? "key a (d or space disarms)" : ""; }

}  // namespace tiller::tools
