#include "tools/base/python_worker.hpp"

#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "tools/base/report.hpp"

namespace tiller::tools {
namespace {

/// The child's input and output; what is printed by accident reaches a person, and no reader of bytes.
int spawn(std::vector<std::string> command, int socket, pid_t& process) {
  std::vector<char*> argv;
  for (std::string& word : command) argv.push_back(word.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, socket, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, STDERR_FILENO, STDOUT_FILENO);
  const int why = posix_spawnp(&process, argv[0], &files, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  return why;
}

}  // namespace

std::unique_ptr<PythonWorker> PythonWorker::start(const std::string& module, const std::vector<std::string>& arguments,
                                                  std::string& error, Socket kind) {
  int ends[2];
  pid_t process = -1;
  const int type = kind == Socket::packets ? SOCK_SEQPACKET : SOCK_STREAM;
  int why = ::socketpair(AF_UNIX, type | SOCK_CLOEXEC, 0, ends) == 0 ? 0 : errno;
  if (why == 0) {
    why = spawn(python_command(module, arguments), ends[1], process);
    ::close(ends[1]);
    if (why != 0) ::close(ends[0]);
  }
  if (why == 0) return std::unique_ptr<PythonWorker>(new PythonWorker(ends[0], process));
  error = "tiller_tools." + module + " cannot be started: " + std::strerror(why);
  return nullptr;
}

PythonWorker::~PythonWorker() {
  ::close(socket_);
  while (::waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

bool PythonWorker::send(const void* data, std::size_t size) {
  const char* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::send(socket_, at, size, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    gone_ = n <= 0;
    if (gone_) return false;
    at += n, size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool PythonWorker::offer(const void* data, std::size_t size) {
  ssize_t n = -1;
  do n = ::send(socket_, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
  while (n < 0 && errno == EINTR);
  if (n >= 0) return true;
  gone_ = errno != EAGAIN && errno != EWOULDBLOCK && errno != ENOBUFS;
  return false;
}

void PythonWorker::end_input() { ::shutdown(socket_, SHUT_WR); }

PythonWorker::Heard PythonWorker::hear(int timeout_ms, std::size_t most, std::string& text) {
  text.clear();
  pollfd waiting = {socket_, POLLIN, 0};
  int ready = -1;
  do ready = ::poll(&waiting, 1, timeout_ms);
  while (ready < 0 && errno == EINTR);
  if (ready == 0) return Heard::nothing;
  text.resize(most);
  const ssize_t n = ::recv(socket_, text.data(), most, 0);
  text.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
  return n > 0 ? Heard::something : Heard::end;
}

void PythonWorker::kill() { ::kill(process_, SIGKILL); }

bool PythonWorker::receive(void* data, std::size_t size) {
  char* at = static_cast<char*>(data);
  while (size > 0) {
    const ssize_t n = ::recv(socket_, at, size, 0);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n, size -= static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace tiller::tools
