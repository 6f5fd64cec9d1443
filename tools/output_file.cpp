#include "tools/output_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

/// True when all bytes are taken; `done` counts those that are.
bool write_all(int descriptor, const std::string& bytes, std::size_t& done) {
  while (done < bytes.size()) {
    const ssize_t taken = ::write(descriptor, bytes.data() + done, bytes.size() - done);
    if (taken < 0 && errno == EINTR) continue;
    if (taken <= 0) return false;
    done += static_cast<std::size_t>(taken);
  }
  return true;
}

}  // namespace

OutputFile::~OutputFile() { close(); }

void OutputFile::open(const std::string& path) {
  path_ = path;
  open_ = true;
  std::error_code ignored;
  const fs::path folder = fs::path(path).parent_path();
  if (!folder.empty()) fs::create_directories(folder, ignored);
  descriptor_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor_ < 0) fail("cannot be created");
}

void OutputFile::fail(const char* what) {
  if (!failure_.empty()) return;
  failure_ = path_ + ": " + what + ": " + std::strerror(errno);
  std::fprintf(stderr, "%s; the run goes on, its rows are kept in memory\n", failure_.c_str());
}

void OutputFile::write(const char* bytes, std::size_t size) {
  if (!open_) return;
  if (pending_.size() + size > kKeep) {
    lost_ = true;
    return;
  }
  pending_.append(bytes, size);
}

bool OutputFile::drain() {
  std::size_t done = 0;
  const bool all = descriptor_ >= 0 && write_all(descriptor_, pending_, done);
  written_ += done;
  pending_.erase(0, done);
  return all;
}

void OutputFile::flush() {
  if (open_ && failure_.empty() && !drain()) fail("cannot be written");
}

bool OutputFile::close() {
  if (!open_) return complete();
  open_ = false;
  if (descriptor_ < 0) descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  const bool on_disk = descriptor_ >= 0 && drain() && !lost_;
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
  return on_disk;
}

bool OutputFile::copy_written(int to) const {
  if (written_ == 0) return true;
  const int from = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
  if (from < 0) return false;
  std::string bytes(written_, '\0');
  const ssize_t got = ::pread(from, bytes.data(), bytes.size(), 0);
  ::close(from);
  std::size_t done = 0;
  return got == static_cast<ssize_t>(bytes.size()) && write_all(to, bytes, done);
}

void OutputFile::rescue() {
  std::error_code code;
  const fs::path folder = fs::temp_directory_path(code);
  std::string copy = (folder / ("tiller-XXXXXX-" + fs::path(path_).filename().string())).string();
  const int suffix = static_cast<int>(fs::path(path_).filename().string().size() + 1);
  const int to = code ? -1 : ::mkstemps(copy.data(), suffix);
  std::size_t done = 0;
  const bool saved = to >= 0 && copy_written(to) && write_all(to, pending_, done);
  if (to >= 0) ::close(to);
  if (saved && !lost_) {
    readable_ = copy;
    message_ = failure_ + "; the log there is incomplete, a complete one is " + copy;
  } else {
    if (to >= 0 && !saved) ::unlink(copy.c_str());
    message_ = failure_ + "; the log is incomplete: free space, or name another folder, and run again" +
               (saved ? "; what could be kept is in " + copy : std::string());
  }
}

}  // namespace tiller::tools
