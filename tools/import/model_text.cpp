#include "tools/import/model_text.hpp"

#include <cctype>

#include "tools/import/unknowns.hpp"

namespace tiller::tools {

std::string type_name(const std::string& robot) {
  std::string out;
  bool up = true;
  for (const char c : identifier(robot)) {
    if (c == '_') {
      up = true;
      continue;
    }
    out += up ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    up = false;
  }
  return out.empty() ? "Robot" : out;
}

std::string fields_text(const char* name, const std::vector<std::string>& list) {
  std::string out = std::string("  TILLER_FIELDS(") + name + ", S";
  const std::string indent(17 + std::string(name).size(), ' ');
  for (std::size_t i = 0; i < list.size(); ++i) {
    out += ",";
    const std::size_t begin = out.rfind('\n') == std::string::npos ? 0 : out.rfind('\n') + 1;
    out += out.size() - begin + list[i].size() > 110 ? "\n" + indent + list[i] : " " + list[i];
  }
  return out + ");\n";
}

std::string listed(const std::vector<std::string>& values, const std::string& indent) {
  std::string out;
  for (std::size_t i = 0; i < values.size(); ++i) out += (i > 0 ? ",\n" + indent : "") + values[i];
  return out;
}

}  // namespace tiller::tools
