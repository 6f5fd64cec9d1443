#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace tiller::tools {

/// JSON has no NaN; what is not finite becomes null. Six digits are more than any result is known to.
inline nlohmann::json number(double value) {
  if (!std::isfinite(value)) return nullptr;
  if (value == 0) return 0.0;
  const double scale = std::pow(10.0, 6 - std::ceil(std::log10(std::fabs(value))));
  return std::isfinite(scale) && scale > 0 ? std::round(value * scale) / scale : value;
}

inline nlohmann::json numbers(const std::vector<double>& values) {
  nlohmann::json list = nlohmann::json::array();
  for (const double v : values) list.push_back(number(v));
  return list;
}

}  // namespace tiller::tools
