#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace tiller::tools {

/// A program that is spoken to in lines over its stdin and stdout. No shell: no character of an argument is special. It
/// is a process group of its own, which is killed when this object goes, and the program itself when this process dies
/// (Linux). Nothing here blocks but start(), until the program is executed.
class LineProcess {
 public:
  LineProcess() = default;
  ~LineProcess() { stop(); }
  LineProcess(const LineProcess&) = delete;
  LineProcess& operator=(const LineProcess&) = delete;

  /// argv[0] is looked up in PATH, or from `folder` where it has a slash; the program runs in `folder`. False with a
  /// sentence in `error`.
  bool start(const std::vector<std::string>& argv, const std::string& folder, std::string& error);
  /// Kills what is left of the group, and reaps it. How it had ended: "ended with exit code 3", "was ended by signal
  /// 11"; "still ran" where it had not. Empty: it was not started.
  std::string stop();

  bool running() const { return process_ > 0; }
  /// Descriptors for poll(); -1 once closed. All of them non-blocking.
  int input() const { return input_; }    ///< of the program: written here
  int output() const { return output_; }  ///< read here
  int errors() const { return errors_; }

  /// Writes as much of `text` as goes, and takes it off. False: nobody reads any more.
  bool write(std::string& text);
  /// Appends what is there. False: the other end is closed; the descriptor then is too.
  bool read_output(std::string& text) { return read(output_, text); }
  bool read_errors(std::string& text) { return read(errors_, text); }

 private:
  static bool read(int& from, std::string& text);

  pid_t process_ = -1;
  int input_ = -1, output_ = -1, errors_ = -1;
};

/// While one lives, a write to a program that is gone is an error and no signal.
class NoBrokenPipes {
 public:
  NoBrokenPipes();
  ~NoBrokenPipes();
  NoBrokenPipes(const NoBrokenPipes&) = delete;
  NoBrokenPipes& operator=(const NoBrokenPipes&) = delete;

 private:
  void (*before_)(int);
};

}  // namespace tiller::tools
