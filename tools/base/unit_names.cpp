#include "tools/base/unit_names.hpp"

#include <algorithm>
#include <cctype>
#include <iterator>
#include <utility>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

// As names write them, and as readers do. A power stands behind as a digit: kgm2, s2.
constexpr std::pair<const char*, const char*> kUnits[] = {
    {"m", "m"},    {"s", "s"},      {"rad", "rad"},   {"kg", "kg"},   {"N", "N"}, {"Nm", "N m"},
    {"Ns", "N s"}, {"kgm", "kg m"}, {"Nms", "N m s"}, {"V", "V"},     {"A", "A"}, {"W", "W"},
    {"J", "J"},    {"K", "K"},      {"Hz", "Hz"},     {"Ohm", "Ohm"}, {"H", "H"}, {"Pa", "Pa"}};
// Letters that mean much else where they stand alone (left, gain, height, the first): units within a ratio that ends in
// h or L.
constexpr const char* kInRatios[] = {"1", "g", "mol", "L", "h"};

/// "kg m^2" of "kgm2"; empty: no unit.
std::string unit_of_word(const std::string& word) {
  const bool power = word.size() > 1 && std::isdigit(static_cast<unsigned char>(word.back()));
  const std::string base = power ? word.substr(0, word.size() - 1) : word;
  for (const auto& [written, read] : kUnits)
    if (base == written) return power ? std::string(read) + "^" + word.back() : read;
  return "";
}

/// "1/h" of "growth_1_h"; empty: no ratio that ends in hours or litres.
std::string process_ratio(const std::string& name) {
  std::string unit, rest = name;
  int parts = 0;
  for (std::size_t at = rest.rfind('_'); at != std::string::npos && at > 0; at = rest.rfind('_'), ++parts) {
    const std::string written = rest.substr(at + 1);
    const bool within = std::find(std::begin(kInRatios), std::end(kInRatios), written) != std::end(kInRatios);
    const std::string word = within ? written : unit_of_word(written);
    if (word.empty() || (parts == 0 && written != "h" && written != "L")) break;
    unit = unit.empty() ? word : word + "/" + unit;
    rest.resize(at);
    if (written == "1") return unit;
  }
  return parts > 1 ? unit : "";
}

}  // namespace

std::string unit_of_field(const std::string& name) {
  std::string unit = process_ratio(name), rest = name;
  if (!unit.empty()) return unit;
  for (std::size_t at = rest.rfind('_'); at != std::string::npos && at > 0; at = rest.rfind('_')) {
    const std::string word = unit_of_word(rest.substr(at + 1));
    if (word.empty()) break;
    unit = unit.empty() ? word : word + "/" + unit;
    rest.resize(at);
  }
  return unit;
}

}  // namespace tiller::tools
