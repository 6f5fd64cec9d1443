#pragma once

#include <fstream>
#include <sstream>
#include <string>

namespace tiller::tools::test {

/// A file's bytes; empty if there is none.
inline std::string read_all(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace tiller::tools::test
