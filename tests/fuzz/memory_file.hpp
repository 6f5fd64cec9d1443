#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "fuzz.hpp"

namespace fuzz {

/// A file that no disk holds, for readers that want a path.
class MemoryFile {
 public:
  MemoryFile() : file_(memfd_create("fuzz", 0)) { require(file_ >= 0, "the kernel gives a file in memory"); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  ~MemoryFile() { close(file_); }
  std::string path() const { return "/proc/self/fd/" + std::to_string(file_); }
  void write(const std::string& content) {
    require(ftruncate(file_, 0) == 0 &&
                pwrite(file_, content.data(), content.size(), 0) == static_cast<ssize_t>(content.size()),
            "and takes what is written to it");
  }

 private:
  int file_;
};

}  // namespace fuzz
