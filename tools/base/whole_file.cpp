#include "tools/base/whole_file.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#include "tools/base/text.hpp"

namespace tiller::tools {

namespace {

/// What the container allows, of control groups version 2 or 1. What it uses already is not taken off: most of that is
/// files that were read, which make room.
std::uint64_t container_bytes() {
  for (const char* path : {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::uint64_t bytes = 0;
    if (std::ifstream(path) >> bytes) return bytes;  // "max": no limit
  }
  return std::numeric_limits<std::uint64_t>::max();
}

}  // namespace

std::uint64_t free_memory_bytes() {
  std::ifstream file("/proc/meminfo");
  std::uint64_t bytes = std::numeric_limits<std::uint64_t>::max(), value = 0;
  std::string name, unit;
  while (file >> name >> value) {
    std::getline(file, unit);
    if (name == "MemAvailable:") bytes = 1024 * value;
  }
  rlimit most{};  // a limit of the process (ulimit -v) as well
  if (getrlimit(RLIMIT_AS, &most) == 0 && most.rlim_cur != RLIM_INFINITY)
    bytes = std::min<std::uint64_t>(bytes, most.rlim_cur);
  return std::min(bytes, container_bytes());
}

std::string too_large_for_memory(const std::string& path, std::uint64_t size, std::uint64_t free) {
  if (size <= free / 3) return "";
  return format(
      "%s: %.1f GB, which take about three times as much memory to read, and %.1f GB are free; cut out the part that "
      "matters (mcap filter, lcm-logfilter), or read it on a larger computer",
      path.c_str(), 1e-9 * static_cast<double>(size), 1e-9 * static_cast<double>(free));
}

bool read_whole_file(const std::string& path, std::string& bytes, std::string& error) {
  bytes.clear();
  std::ifstream file(path, std::ios::binary);
  std::error_code code;
  const std::uintmax_t size = std::filesystem::is_regular_file(path, code) ? std::filesystem::file_size(path, code) : 0;
  if (!file || std::filesystem::is_directory(path, code)) {
    error = path + ": cannot be read: " + (file ? "it is a folder" : std::strerror(errno));
    return false;
  }
  error = too_large_for_memory(path, size, free_memory_bytes());
  if (!error.empty()) return false;
  bytes.reserve(size);
  char piece[1 << 16];
  while (file.read(piece, sizeof piece) || file.gcount() > 0)
    bytes.append(piece, static_cast<std::size_t>(file.gcount()));
  if (file.bad()) error = path + ": cannot be read to its end: " + std::strerror(errno);
  return error.empty();
}

}  // namespace tiller::tools
