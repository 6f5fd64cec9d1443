#include "tools/base/file_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>

namespace tiller::tools {
namespace {

constexpr int kAttemptsPerSecond = 10;

void wait_a_little() {
  const timespec time = {0, 1000000000 / kAttemptsPerSecond};
  nanosleep(&time, nullptr);
}

}  // namespace

FileLock::~FileLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void FileLock::take(const std::string& path, const std::function<void(int)>& each_second) {
  descriptor_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (descriptor_ < 0) return;
  for (int attempt = 0;; ++attempt) {
    held_ = ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0;
    if (held_ || (errno != EWOULDBLOCK && errno != EINTR)) return;
    if (attempt % kAttemptsPerSecond == 0) each_second(attempt / kAttemptsPerSecond);
    wait_a_little();
  }
}

}  // namespace tiller::tools
