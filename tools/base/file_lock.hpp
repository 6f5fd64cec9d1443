#pragma once

#include <functional>
#include <string>

namespace tiller::tools {

/// A file that one process holds at a time; the kernel lets go of it when that process ends, however it ends. Where the
/// disk has no locks nobody holds it, and everybody goes on.
class FileLock {
 public:
  FileLock() = default;
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

  /// Waits until the lock is there; `each_second` is told the seconds so far, 0 as soon as somebody else holds it.
  void take(const std::string& path, const std::function<void(int seconds)>& each_second);
  bool held() const { return held_; }

 private:
  int descriptor_ = -1;
  bool held_ = false;
};

}  // namespace tiller::tools
