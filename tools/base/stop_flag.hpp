#pragma once

#include <csignal>

namespace tiller::tools {

/// SIGINT and SIGTERM set a flag while an object of this class lives; a second one ends the process.
class StopFlag {
 public:
  StopFlag();
  ~StopFlag();
  StopFlag(const StopFlag&) = delete;
  StopFlag& operator=(const StopFlag&) = delete;
  const volatile std::sig_atomic_t& flag() const;
};

}  // namespace tiller::tools
