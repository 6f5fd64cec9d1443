#include "tools/base/output_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <new>

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

/// True when all bytes are taken; `done` counts those that are. `offset` below zero: where the descriptor stands.
bool write_all(int descriptor, const std::string& bytes, std::size_t& done, off_t offset = -1) {
  while (done < bytes.size()) {
    const char* from = bytes.data() + done;
    const std::size_t size = bytes.size() - done;
    const ssize_t taken = offset < 0 ? ::write(descriptor, from, size)
                                     : ::pwrite(descriptor, from, size, offset + static_cast<off_t>(done));
    if (taken < 0 && errno == EINTR) continue;
    if (taken <= 0) return false;
    done += static_cast<std::size_t>(taken);
  }
  return true;
}

}  // namespace

void make_folders_for(const std::string& path) {
  std::error_code code;
  const fs::path folder = fs::path(path).parent_path();
  if (!folder.empty() && fs::create_directories(folder, code))
    std::fprintf(stderr, "tiller: made the folder %s\n", folder.c_str());
}

bool can_write_file(const std::string& path, std::string& error) {
  make_folders_for(path);
  std::error_code code;
  const bool is_new = !fs::exists(fs::symlink_status(path, code));
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor >= 0) {
    ::close(descriptor);
    if (is_new) ::unlink(path.c_str());
    return true;
  }
  error = path + ": cannot be written: " + std::strerror(errno) + "; name another file";
  return false;
}

OutputFile::~OutputFile() { close(); }

void OutputFile::open(const std::string& path) {
  path_ = path;
  open_ = true;
  make_folders_for(path);
  create();
  if (descriptor_ < 0) fail("cannot be created");
}

void OutputFile::create() {
  descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  struct stat status {};
  overwritable_ = descriptor_ >= 0 && ::fstat(descriptor_, &status) == 0 && S_ISREG(status.st_mode);
}

void OutputFile::fail(const char* what) {
  if (!failure_.empty()) return;
  failure_ = path_ + ": " + what + ": " + std::strerror(errno);
  std::fprintf(stderr, "%s; the run goes on, its rows are kept in memory\n", failure_.c_str());
}

bool OutputFile::write(const char* bytes, std::size_t size) {
  if (!open_) return false;
  bool kept = pending_.size() + size <= kKeep;
  try {
    if (kept) pending_.append(bytes, size);
  } catch (const std::bad_alloc&) {  // what a run may lock in memory is limited
    kept = false;
  }
  if (kept) return true;
  lost_ = true;
  lost_bytes_ += size;
  return false;
}

bool OutputFile::drain() {
  if (descriptor_ < 0) create();
  if (descriptor_ < 0) return false;
  const std::size_t body = pending_.size();
  std::size_t done = 0;
  try {
    if (overwritable_) pending_ += tail_;
  } catch (const std::bad_alloc&) {  // without its tail, the file is one that was cut off here
  }
  const bool all = write_all(descriptor_, pending_, done, overwritable_ ? static_cast<off_t>(written_) : off_t{-1});
  done = std::min(done, body);
  pending_.resize(body);
  written_ += done;
  pending_.erase(0, done);
  return all;
}

void OutputFile::flush() {
  if (!open_ || (pending_.empty() && failure_.empty())) return;
  lags_ = !drain();
  if (lags_) fail(descriptor_ < 0 ? "cannot be created" : "cannot be written");
}

bool OutputFile::close() {
  if (!open_) return complete();
  open_ = false;
  tail_.clear();
  const bool drained = drain();
  // what is left of a tail would stand behind the end
  const bool on_disk =
      drained && !lost_ && (!overwritable_ || ::ftruncate(descriptor_, static_cast<off_t>(written_)) == 0);
  if (on_disk) {
    readable_ = path_;
    if (!failure_.empty()) message_ = failure_ + "; it could be completed at the end of the run";
    failure_.clear();
  } else {
    if (failure_.empty()) fail("cannot be written");
    rescue();
  }
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
  lags_ = !on_disk;
  return on_disk;
}

bool OutputFile::copy_written(int to) const {
  if (written_ == 0) return true;
  const int from = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
  if (from < 0) return false;
  std::string piece;
  bool good = true;
  for (std::size_t at = 0; good && at < written_; at += piece.size()) {
    piece.resize(std::min(std::size_t{1} << 20, written_ - at));
    const ssize_t got = ::pread(from, piece.data(), piece.size(), static_cast<off_t>(at));
    std::size_t done = 0;
    good = got == static_cast<ssize_t>(piece.size()) && write_all(to, piece, done);
  }
  ::close(from);
  return good;
}

void OutputFile::rescue() {
  std::error_code code;
  const fs::path folder = fs::temp_directory_path(code);
  std::string copy = (folder / ("tiller-XXXXXX-" + fs::path(path_).filename().string())).string();
  const int suffix = static_cast<int>(fs::path(path_).filename().string().size() + 1);
  const int to = code ? -1 : ::mkstemps(copy.data(), suffix);
  std::size_t done = 0;
  struct statvfs disk {};  // the copy of a long log must not fill the next disk, which may be the memory
  const bool room = to >= 0 && ::fstatvfs(to, &disk) == 0 &&
                    std::uint64_t{disk.f_bavail} * disk.f_frsize / 2 >= written_ + pending_.size();
  const bool saved = room && copy_written(to) && write_all(to, pending_, done);
  if (to >= 0) ::close(to);
  if (saved && !lost_) {
    readable_ = copy;
    message_ = failure_ + "; the log there is incomplete, a complete one is " + copy;
  } else {
    if (to >= 0 && !saved) ::unlink(copy.c_str());
    message_ =
        failure_ + "; the log is incomplete: free space, or name another folder, and run again" +
        (saved              ? "; what could be kept is in " + copy
         : to >= 0 && !room ? "; half of what is free in " + folder.string() + " does not hold a copy of " +
                                  std::to_string((written_ + pending_.size()) >> 20) + " MB (TMPDIR names another)"
                            : std::string());
  }
}

namespace {

/// The temporary file, open and locked; -1 with errno set. Whoever had it before may have renamed it in between: then
/// the lock is on what is published now, and the temporary file is another one.
int open_locked(const std::string& path) {
  for (int attempt = 0; attempt < 100; ++attempt) {
    const int descriptor = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (descriptor < 0) return -1;
    struct stat mine {
    }, there{};
    const bool held = ::flock(descriptor, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK;  // not every disk has locks
    if (!held) {
      ::close(descriptor);
      errno = EBUSY;
      return -1;
    }
    if (::fstat(descriptor, &mine) == 0 && ::stat(path.c_str(), &there) == 0 && mine.st_ino == there.st_ino)
      return descriptor;
    ::close(descriptor);
  }
  errno = EBUSY;
  return -1;
}

bool sync_folder(const std::string& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return errno == EACCES;  // writable but not readable: nothing more can be done
  const bool synced = ::fsync(descriptor) == 0 || errno == EINVAL;
  ::close(descriptor);
  return synced;
}

}  // namespace

bool replace_file(const std::string& path, const std::string& bytes, std::string& error) {
  std::error_code code;
  // a link goes on pointing to the file that is replaced
  const fs::path target = fs::is_symlink(path, code) ? fs::weakly_canonical(path, code) : fs::path(path);
  const fs::file_status status = fs::status(target, code);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    error = path + ": is " + (fs::is_directory(status) ? "a folder" : "no ordinary file") + "; name another file";
    return false;
  }
  const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
  make_folders_for(target.string());
  const std::string temporary = (folder / ("." + target.filename().string() + ".tmp")).string();
  const char* doing = "cannot be created";
  const int descriptor = open_locked(temporary);
  std::size_t done = 0;
  bool good = descriptor >= 0;
  if (good) {
    doing = "cannot be written";
    good = ::ftruncate(descriptor, 0) == 0 && write_all(descriptor, bytes, done) && ::fsync(descriptor) == 0;
    if (good) {
      doing = "cannot be put in its place";
      good = ::rename(temporary.c_str(), target.c_str()) == 0 && sync_folder(folder.string());
    }
  }
  const int why = errno;
  if (!good && descriptor >= 0) ::unlink(temporary.c_str());
  if (descriptor >= 0) ::close(descriptor);
  if (good) return true;
  error = path + ": " + doing + ": " + (why == EBUSY ? "another process is writing it" : std::strerror(why)) +
          "; free space or name another folder; what stood there stands there still";
  return false;
}

}  // namespace tiller::tools
