#include "tools/base/spill_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <new>

namespace tiller::tools {
namespace {

/// A file that has no name. Some file systems (FAT on a memory card) have no such files: there one with a name is made
/// and its name removed.
int open_nameless(const std::string& folder) {
  const int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor >= 0) return descriptor;
  std::string path = folder + "/.tiller-XXXXXX";
  const int named = ::mkostemp(path.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(path.c_str());
  return named;
}

}  // namespace

SpillFile::~SpillFile() { (void)fail(); }

/// Gives everything up.
bool SpillFile::fail() {
  failed_ = true;
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
  std::string().swap(recent_);
  return false;
}

bool SpillFile::spill() {
  if (descriptor_ < 0) descriptor_ = open_nameless(folder_);
  if (descriptor_ < 0) return false;
  for (std::size_t done = 0; done < recent_.size();) {
    const ssize_t taken = ::write(descriptor_, recent_.data() + done, recent_.size() - done);
    if (taken < 0 && errno == EINTR) continue;
    if (taken <= 0) {  // the next call writes all of it again
      (void)::ftruncate(descriptor_, static_cast<off_t>(in_file_));
      (void)::lseek(descriptor_, static_cast<off_t>(in_file_), SEEK_SET);
      return false;
    }
    done += static_cast<std::size_t>(taken);
  }
  in_file_ += recent_.size();
  recent_.clear();
  return true;
}

bool SpillFile::append(const std::string& bytes) {
  if (failed_) return false;
  const bool full = !recent_.empty() && recent_.size() + bytes.size() > kPiece;
  if (full && !spill() && recent_.size() + bytes.size() > kWaiting) return fail();
  try {
    recent_ += bytes;
  } catch (const std::bad_alloc&) {  // what a run may lock in memory is limited
    return fail();
  }
  size_ += bytes.size();
  return true;
}

bool SpillFile::each(const std::function<void(const std::string&)>& take) const {
  if (failed_) return false;
  std::string piece;
  for (std::uint64_t at = 0; at < in_file_; at += piece.size()) {
    piece.resize(static_cast<std::size_t>(std::min<std::uint64_t>(kPiece, in_file_ - at)));
    const ssize_t got = ::pread(descriptor_, piece.data(), piece.size(), static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) {
      piece.clear();
      continue;
    }
    if (got <= 0) return false;
    piece.resize(static_cast<std::size_t>(got));
    take(piece);
  }
  if (!recent_.empty()) take(recent_);
  return true;
}

}  // namespace tiller::tools
