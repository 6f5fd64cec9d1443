#include "tools/base/child_process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>

namespace tiller::tools {
namespace {

constexpr int kForwarded[] = {SIGINT, SIGTERM, SIGHUP};

/// A pipe whose ends do not reach a program that is started.
struct Pipe {
  int read = -1, write = -1;
  bool open() {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) return false;
    read = ends[0];
    write = ends[1];
    return true;
  }
  static void close(int& end) {
    if (end >= 0) ::close(end);
    end = -1;
  }
  ~Pipe() {
    close(read);
    close(write);
  }
};

bool read_byte(int from) {
  char byte = 0;
  ssize_t n = 0;
  do n = ::read(from, &byte, 1);
  while (n < 0 && errno == EINTR);
  return n == 1;
}

/// Waits for one process; its wait status.
int reap(pid_t process) {
  int status = 0;
  while (waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

// ---- signals ----------------------------------------------------------------------------------------

volatile std::sig_atomic_t caught = 0;
void note_signal(int signal) { caught = signal; }

/// Holds the signals that end a process back, so that the child's group ends first. A signal that was ignored stays
/// ignored (nohup).
class HeldSignals {
 public:
  HeldSignals() {
    caught = 0;
    sigset_t held;
    sigemptyset(&held);
    for (const int signal : kForwarded) sigaddset(&held, signal);
    sigprocmask(SIG_BLOCK, &held, &before_);
    for (std::size_t i = 0; i < kCount; ++i) {
      struct sigaction noting = {};
      noting.sa_handler = note_signal;
      sigaction(kForwarded[i], nullptr, &actions_[i]);
      if (actions_[i].sa_handler != SIG_IGN) sigaction(kForwarded[i], &noting, nullptr);
    }
  }
  ~HeldSignals() {
    for (std::size_t i = 0; i < kCount; ++i) sigaction(kForwarded[i], &actions_[i], nullptr);
    sigprocmask(SIG_SETMASK, &before_, nullptr);
    if (caught != 0) raise(caught);
  }
  HeldSignals(const HeldSignals&) = delete;
  HeldSignals& operator=(const HeldSignals&) = delete;
  const sigset_t& before() const { return before_; }

 private:
  static constexpr std::size_t kCount = sizeof kForwarded / sizeof kForwarded[0];
  sigset_t before_{};
  struct sigaction actions_[kCount] = {};
};

// ---- the child --------------------------------------------------------------------------------------

/// Between fork and exec: nothing but what a signal handler might call.
/// Nothing is executed before the guard is there (`go`): what the program starts must not outlive a killed owner.
[[noreturn]] void become(char* const* words, int go, int output, int failure, const sigset_t& mask) {
  setpgid(0, 0);
  if (!read_byte(go)) _exit(127);
  const int nothing = ::open("/dev/null", O_RDONLY);
  dup2(nothing, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(output, STDERR_FILENO);
  sigprocmask(SIG_SETMASK, &mask, nullptr);
  execvp(words[0], words);
  const int why = errno;
  (void)!::write(failure, &why, sizeof why);
  _exit(127);
}

/// Ends the child's group when the other end of `lifeline` closes without a byte: its owner was killed. A compiler
/// driver that is told to end removes its temporary files, and what does not listen is killed. Being of the group, the
/// guard keeps its number from being given to another one meanwhile.
[[noreturn]] void guard(pid_t group, int lifeline) {
  for (const int signal : kForwarded) std::signal(signal, SIG_IGN);
  setpgid(0, group);
  if (!read_byte(lifeline)) {
    ::kill(-group, SIGTERM);
    const timespec grace = {0, 500000000};
    nanosleep(&grace, nullptr);
    ::kill(-group, SIGKILL);
  }
  _exit(0);
}

/// A started program, its guard, and the ends of the pipes to both.
class Child {
 public:
  ~Child() {
    if (guard_ > 0) {
      (void)!::write(lifeline_.write, "", 1);
      reap(guard_);
    }
  }

  /// 0, or why not.
  int start(char* const* words, const sigset_t& mask) {
    Pipe failure, go;
    if (!output_.open() || !lifeline_.open() || !failure.open() || !go.open()) return errno;
    child_ = fork();
    if (child_ < 0) return errno;
    if (child_ == 0) {
      Pipe::close(go.write);
      become(words, go.read, output_.write, failure.write, mask);
    }
    setpgid(child_, child_);  // whichever of the two is first
    guard_ = fork();
    if (guard_ == 0) {
      for (int* end : {&lifeline_.write, &output_.read, &output_.write, &failure.read, &failure.write, &go.write})
        Pipe::close(*end);
      guard(child_, lifeline_.read);
    }
    Pipe::close(output_.write);
    Pipe::close(failure.write);
    if (guard_ > 0) (void)!::write(go.write, "", 1);
    Pipe::close(go.write);
    int why = 0;
    ssize_t n = 0;
    do n = ::read(failure.read, &why, sizeof why);
    while (n < 0 && errno == EINTR);
    if (n == sizeof why || guard_ < 0) {
      reap(child_);
      return n == sizeof why ? why : EAGAIN;
    }
    return 0;
  }

  /// Reads what it writes until it ends. Interrupted: its group is told to end, and killed if it does not.
  void follow(const sigset_t& mask, std::string& output, const std::function<void(int)>& each_second) {
    using Clock = std::chrono::steady_clock;
    const auto begin = Clock::now();
    bool told = false;
    for (int second = 1;;) {
      if (caught != 0 && !told) {
        ::kill(-child_, SIGTERM);
        told = true;
        second = 0;
      }
      const auto due = told ? Clock::now() + std::chrono::seconds(1) : begin + std::chrono::seconds(second);
      const auto left = std::chrono::duration_cast<std::chrono::nanoseconds>(due - Clock::now()).count();
      const timespec wait = {left > 0 ? left / 1000000000 : 0, left > 0 ? left % 1000000000 : 0};
      pollfd end = {output_.read, POLLIN, 0};
      const int ready = ppoll(&end, 1, &wait, &mask);
      if (ready == 0 && told) ::kill(-child_, SIGKILL);
      if (ready == 0 && !told && each_second) each_second(second);
      if (ready == 0) ++second;
      if (ready > 0 && !read_some(output)) return;
    }
  }

  int exit_code() {
    const int status = reap(child_);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  bool read_some(std::string& output) {
    char buffer[4096];
    const ssize_t n = ::read(output_.read, buffer, sizeof buffer);
    if (n > 0) output.append(buffer, static_cast<std::size_t>(n));
    return n > 0 || (n < 0 && errno == EINTR);
  }

  Pipe output_, lifeline_;
  pid_t child_ = -1, guard_ = -1;
};

}  // namespace

ChildResult run_child(const std::vector<std::string>& argv, const std::function<void(int)>& each_second) {
  ChildResult result;
  std::vector<char*> words;
  words.reserve(argv.size() + 1);
  for (const std::string& word : argv) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  const HeldSignals held;
  Child child;
  const int why = child.start(words.data(), held.before());
  if (why != 0) {
    result.output = std::strerror(why);
    return result;
  }
  result.started = true;
  child.follow(held.before(), result.output, each_second);
  result.exit_code = child.exit_code();
  return result;
}

}  // namespace tiller::tools
