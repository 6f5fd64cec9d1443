#include "sim/mechanisms/options.hpp"

#include <cmath>
#include <cstdlib>
#include <sstream>

namespace tiller::sim {

bool parse_assignment(const std::string& text, std::map<std::string, double>& values, std::string& error) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    error = "'" + text + "': expected name=value";
    return false;
  }
  const std::string name = text.substr(0, equals);
  const std::string number = text.substr(equals + 1);
  char* end = nullptr;
  const double value = std::strtod(number.c_str(), &end);
  if (number.empty() || *end != '\0' || !std::isfinite(value)) {
    error = "'" + text + "': '" + number + "' is not a finite number";
    return false;
  }
  if (!values.emplace(name, value).second) {
    error = "'" + name + "' is given twice";
    return false;
  }
  return true;
}

bool parse_effect(const std::string& text, HiddenEffect& effect, std::string& error) {
  effect = HiddenEffect{};
  const auto colon = text.find(':');
  const std::string head = text.substr(0, colon);
  const auto at = head.find('@');
  effect.kind = head.substr(0, at);
  if (at != std::string::npos) effect.port = head.substr(at + 1);
  if (effect.kind.empty() || (at != std::string::npos && effect.port.empty())) {
    error = "'" + text + "': expected kind:name=value or kind@port:name=value";
    return false;
  }
  if (colon == std::string::npos) return true;
  std::istringstream list(text.substr(colon + 1));
  for (std::string item; std::getline(list, item, ',');) {
    if (!parse_assignment(item, effect.parameters, error)) return false;
  }
  return true;
}

}  // namespace tiller::sim
