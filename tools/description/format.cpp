#include <tinyxml2.h>

#include <cstring>
#include <fstream>
#include <iterator>

#include "tools/description/description.hpp"

namespace tiller::tools {

bool read_description(const std::string& path, Description& robot, std::vector<std::string>& errors) {
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const char mjb[] = {'1', '\xd4', 0, 0};  // 54321 in the file's first four bytes
  if (text.size() > sizeof mjb && std::memcmp(text.data(), mjb, sizeof mjb) == 0) return read_mjcf(path, robot, errors);
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first != std::string::npos && text[first] == '{') return read_compiled_mjcf(text, path, robot, errors);
  tinyxml2::XMLDocument document;
  const bool is_xml = document.Parse(text.data(), text.size()) == tinyxml2::XML_SUCCESS;
  const tinyxml2::XMLElement* root = is_xml ? document.RootElement() : nullptr;
  const bool is_mjcf = root != nullptr && std::strcmp(root->Name(), "mujoco") == 0;
  return is_mjcf ? read_mjcf(path, robot, errors) : read_urdf(path, robot, errors);
}

}  // namespace tiller::tools
