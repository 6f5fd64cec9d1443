#pragma once

#include <string>

namespace tiller::tools {

/// A line on stderr for what takes a while: what it is, and the seconds so far. On a terminal the line is rewritten
/// every second; elsewhere it is told at once, after two seconds, and then every ten.
class WaitLine {
 public:
  explicit WaitLine(std::string what);
  void show(int seconds);
  /// Ends the line; `outcome` stands behind it, with the seconds that it took.
  void end(const std::string& outcome, int seconds);

 private:
  std::string what_;
  bool terminal_;
};

}  // namespace tiller::tools
