#include "tools/simulator/line_process.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

void close_one(int& descriptor) {
  if (descriptor >= 0) ::close(descriptor);
  descriptor = -1;
}

/// Three pairs of ends, closed with the object but for those that were taken.
struct Ends {
  int in[2] = {-1, -1}, out[2] = {-1, -1}, err[2] = {-1, -1}, failure[2] = {-1, -1};
  bool open() {
    return pipe2(in, O_CLOEXEC) == 0 && pipe2(out, O_CLOEXEC) == 0 && pipe2(err, O_CLOEXEC) == 0 &&
           pipe2(failure, O_CLOEXEC) == 0;
  }
  ~Ends() {
    for (int* pair : {in, out, err, failure})
      for (int i = 0; i < 2; ++i) close_one(pair[i]);
  }
};

int take(int& descriptor) {
  const int taken = descriptor;
  descriptor = -1;
  fcntl(taken, F_SETFL, fcntl(taken, F_GETFL) | O_NONBLOCK);
  return taken;
}

/// Between fork and exec: nothing but what a signal handler might call.
[[noreturn]] void become(char* const* words, const char* folder, const Ends& ends, pid_t owner) {
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != owner) _exit(127);  // it died meanwhile
  dup2(ends.in[0], STDIN_FILENO);
  dup2(ends.out[1], STDOUT_FILENO);
  dup2(ends.err[1], STDERR_FILENO);
  std::signal(SIGPIPE, SIG_DFL);
  if (*folder == '\0' || chdir(folder) == 0) execvp(words[0], words);
  const int why = errno;
  (void)!::write(ends.failure[1], &why, sizeof why);
  _exit(127);
}

int wait_for(pid_t process, int flags, int& status) {
  int got = 0;
  do got = waitpid(process, &status, flags);
  while (got < 0 && errno == EINTR);
  return got;
}

/// What to do about a program that is not executed.
const char* remedy_of(int why) {
  if (why == EACCES) return "make it executable (chmod +x), or name its interpreter in front of it";
  if (why == ENOENT || why == ENOTDIR)
    return "check folder and name; a program without a slash in its name is looked for in PATH, one with a slash from "
           "that folder on";
  return "try it by hand in that folder";
}

std::string ending_of(int status) {
  if (WIFEXITED(status)) return format("ended with exit code %d", WEXITSTATUS(status));
  return format("was ended by signal %d (%s)", WTERMSIG(status), strsignal(WTERMSIG(status)));
}

}  // namespace

bool LineProcess::start(const std::vector<std::string>& argv, const std::string& folder, std::string& error) {
  stop();
  Ends ends;
  if (!ends.open()) {
    error = std::string("no pipe to ") + argv[0] + ": " + std::strerror(errno) + "; run fewer --processes";
    return false;
  }
  std::vector<char*> words;
  for (const std::string& word : argv) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  const pid_t owner = getpid(), child = fork();
  if (child == 0) become(words.data(), folder.c_str(), ends, owner);
  int why = child < 0 ? errno : 0;
  close_one(ends.failure[1]);
  ssize_t n = 0;
  if (child > 0) {
    setpgid(child, child);  // whichever of the two is first
    do n = ::read(ends.failure[0], &why, sizeof why);
    while (n < 0 && errno == EINTR);
  }
  if (child < 0 || n == sizeof why) {
    int status = 0;
    if (child > 0) wait_for(child, 0, status);
    error = "cannot start " + argv[0] + " in " + (folder.empty() ? "." : folder) + ": " + std::strerror(why) + "; " +
            remedy_of(why);
    return false;
  }
  process_ = child;
  input_ = take(ends.in[1]);
  output_ = take(ends.out[0]);
  errors_ = take(ends.err[0]);
  return true;
}

std::string LineProcess::stop() {
  close_one(input_);
  close_one(output_);
  close_one(errors_);
  if (process_ <= 0) return "";
  int status = 0;
  // whoever closes its stdout ends at once after it, most often: an ending of its own says more than a kill
  for (int tries = 0; tries < 20; ++tries) {
    if (wait_for(process_, WNOHANG, status) == process_) {
      ::kill(-process_, SIGKILL);  // its own children
      process_ = -1;
      return ending_of(status);
    }
    const timespec a_while = {0, 1000000};
    nanosleep(&a_while, nullptr);
  }
  ::kill(-process_, SIGKILL);
  wait_for(process_, 0, status);
  process_ = -1;
  return "still ran";
}

bool LineProcess::write(std::string& text) {
  while (!text.empty()) {
    const ssize_t n = ::write(input_, text.data(), text.size());
    if (n > 0) {
      text.erase(0, static_cast<std::size_t>(n));
    } else if (n < 0 && errno != EINTR) {
      return errno == EAGAIN || errno == EWOULDBLOCK;
    }
  }
  return true;
}

bool LineProcess::read(int& from, std::string& text) {
  char buffer[65536];
  for (;;) {
    const ssize_t n = ::read(from, buffer, sizeof buffer);
    if (n > 0) {
      text.append(buffer, static_cast<std::size_t>(n));
    } else if (n < 0 && errno == EINTR) {
      continue;
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      return true;
    } else {
      close_one(from);
      return false;
    }
  }
}

NoBrokenPipes::NoBrokenPipes() : before_(std::signal(SIGPIPE, SIG_IGN)) {}
NoBrokenPipes::~NoBrokenPipes() { std::signal(SIGPIPE, before_); }

}  // namespace tiller::tools
