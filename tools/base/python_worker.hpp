#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace tiller::tools {

/// A Python tool (tiller_tools.<module>) that stays for many questions: its standard input is a socket for both ways,
/// its standard output goes to standard error. It ends with this object, and where this process is killed by the end of
/// its input. One thread at a time.
class PythonWorker {
 public:
  enum class Socket : std::uint8_t {
    stream,
    packets  ///< what is sent arrives as one piece, or not at all
  };

  /// Null with a sentence in `error`.
  static std::unique_ptr<PythonWorker> start(const std::string& module, const std::vector<std::string>& arguments,
                                             std::string& error, Socket kind = Socket::stream);
  ~PythonWorker();
  PythonWorker(const PythonWorker&) = delete;
  PythonWorker& operator=(const PythonWorker&) = delete;

  /// False where the other end is gone.
  bool send(const void* data, std::size_t size);
  bool receive(void* data, std::size_t size);

  /// A packet that must not wait. False: the queue is full, or the other end is gone (is_gone()).
  bool offer(const void* data, std::size_t size);
  /// The last offer() or send() met nobody.
  bool is_gone() const { return gone_; }
  /// Nothing more will be sent: the other end reads what is left, and then the end.
  void end_input();
  enum class Heard : std::uint8_t { something, nothing, end };
  /// Whatever the other end says within `timeout_ms` (-1: without an end): up to `most` bytes go into `text`.
  Heard hear(int timeout_ms, std::size_t most, std::string& text);
  /// Ends a process that does not answer.
  void kill();

 private:
  PythonWorker(int socket, pid_t process) : socket_(socket), process_(process) {}

  int socket_;
  pid_t process_;
  bool gone_ = false;
};

}  // namespace tiller::tools
