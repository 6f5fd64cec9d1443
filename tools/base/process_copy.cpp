#include "tools/base/process_copy.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>

namespace tiller::tools {
namespace {

constexpr unsigned kMostWait_s = 60;  // a busy machine gives a copy its processor time late

[[noreturn]] void work_and_end(const std::function<std::string()>& work, unsigned most_cpu_seconds, int to) {
  const rlimit none = {0, 0}, time = {most_cpu_seconds, most_cpu_seconds + 1};
  setrlimit(RLIMIT_CORE, &none);
  setrlimit(RLIMIT_CPU, &time);
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGALRM, SIGXCPU}) std::signal(signal, SIG_DFL);
  sigset_t alarm_alone;
  sigemptyset(&alarm_alone);
  sigaddset(&alarm_alone, SIGALRM);
  sigprocmask(SIG_UNBLOCK, &alarm_alone, nullptr);
  alarm(kMostWait_s);
  const std::string answer = work();
  for (std::size_t at = 0; at < answer.size();) {
    const ssize_t n = write(to, answer.data() + at, answer.size() - at);
    if (n <= 0 && errno != EINTR) _exit(1);
    if (n > 0) at += static_cast<std::size_t>(n);
  }
  _exit(0);
}

}  // namespace

CopyResult run_in_copy(const std::function<std::string()>& work, unsigned most_cpu_seconds) {
  CopyResult result;
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return result;
  const pid_t copy = fork();
  if (copy == 0) work_and_end(work, most_cpu_seconds, ends[1]);
  close(ends[1]);
  char buffer[4096];
  for (ssize_t n = 0; copy > 0 && ((n = read(ends[0], buffer, sizeof buffer)) > 0 || (n < 0 && errno == EINTR));)
    if (n > 0) result.answer.append(buffer, static_cast<std::size_t>(n));
  close(ends[0]);
  if (copy < 0) return result;
  int status = 0;
  while (waitpid(copy, &status, 0) < 0)
    if (errno != EINTR) return result;
  result.started = true;
  if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
  return result;
}

}  // namespace tiller::tools
