#pragma once

// What a fuzzer's source includes. It defines LLVMFuzzerTestOneInput, which any engine drives: libFuzzer in a build with
// TILLER_FUZZ, run_corpus.cpp elsewhere.

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace fuzz {

/// A finding of the fuzzer's own: what came out breaks a promise.
inline void require(bool promise, const char* what) {
  if (promise) return;
  std::fprintf(stderr, "broken promise: %s\n", what);
  std::abort();
}

/// The bytes of an input, taken from the front; zeros once there are none.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  bool empty() const { return size_ == 0; }
  std::uint8_t byte() {
    if (size_ == 0) return 0;
    --size_;
    return *data_++;
  }
  std::uint32_t word() {
    std::uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value = value << 8 | byte();
    return value;
  }
  /// At most `count` bytes, as a copy of exactly that length, so that a sanitizer sees the first byte beyond.
  std::string take(std::size_t count) {
    const std::size_t n = count < size_ ? count : size_;
    std::string part(reinterpret_cast<const char*>(data_), n);
    data_ += n;
    size_ -= n;
    return part;
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

/// A file in memory, for readers that take a path.
class MemoryFile {
 public:
  MemoryFile() : file_(memfd_create("fuzz", MFD_CLOEXEC)), path_("/proc/self/fd/" + std::to_string(file_)) {}
  ~MemoryFile() { close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  const std::string& hold(const std::uint8_t* data, std::size_t size) {
    require(ftruncate(file_, 0) == 0 && lseek(file_, 0, SEEK_SET) == 0, "a file in memory can be emptied");
    require(write(file_, data, size) == static_cast<ssize_t>(size), "a file in memory takes an input");
    return path_;
  }

 private:
  int file_;
  std::string path_;
};

}  // namespace fuzz
