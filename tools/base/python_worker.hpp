#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace tiller::tools {

/// A Python tool (tiller_tools.<module>) that stays for many questions: its standard input is a socket for both ways,
/// its standard output goes to standard error. It ends with this object, and where this process is killed by the end of
/// its input. One thread at a time.
class PythonWorker {
 public:
  /// Null with a sentence in `error`.
  static std::unique_ptr<PythonWorker> start(const std::string& module, const std::vector<std::string>& arguments,
                                             std::string& error);
  ~PythonWorker();
  PythonWorker(const PythonWorker&) = delete;
  PythonWorker& operator=(const PythonWorker&) = delete;

  /// False where the other end is gone.
  bool send(const void* data, std::size_t size);
  bool receive(void* data, std::size_t size);

 private:
  PythonWorker(int socket, pid_t process) : socket_(socket), process_(process) {}

  int socket_;
  pid_t process_;
};

}  // namespace tiller::tools
