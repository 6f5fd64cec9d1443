#include "tools/base/shipped_robots.hpp"

#include <cstdlib>
#include <filesystem>

#include "python_config.hpp"

namespace tiller::tools {

namespace fs = std::filesystem;

std::string shipped_robots() {
  std::error_code code;
  if (const char* named = std::getenv("TILLER_ROBOTS"); named && *named) return named;
  if (fs::exists(fs::path(TILLER_ROBOTS_SOURCE), code)) return TILLER_ROBOTS_SOURCE;
  const fs::path self = fs::read_symlink("/proc/self/exe", code);
  return (self.parent_path().parent_path() / TILLER_ROBOTS_INSTALLED).string();
}

}  // namespace tiller::tools
