#include "tools/base/stop_flag.hpp"

namespace tiller::tools {
namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};

volatile std::sig_atomic_t stop_requested = 0;

void on_signal(int signal) {
  if (stop_requested != 0) std::signal(signal, SIG_DFL);  // asked twice: the next one ends the process
  stop_requested = 1;
}

}  // namespace

StopFlag::StopFlag() {
  stop_requested = 0;
  for (const int signal : kSignals) {
    const auto before = std::signal(signal, on_signal);
    if (signal == SIGHUP && before == SIG_IGN) std::signal(signal, SIG_IGN);  // nohup: meant to outlive the terminal
  }
  // a reader of the progress that goes away (`| head`) must not end the process between two commands
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);  // nor a log that reaches the limit of a file's size: its write fails instead
}
StopFlag::~StopFlag() {
  for (const int signal : kSignals) std::signal(signal, SIG_DFL);
}
const volatile std::sig_atomic_t& StopFlag::flag() const { return stop_requested; }

}  // namespace tiller::tools
