#include "tools/tune/search_key.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "tools/robot/robot_schema.hpp"
#include "tools/tune/number_edit.hpp"

namespace tiller::tools::tune {
namespace {

const Words& open_sections() {
  static const Words sections = {"planner", "cost", "posterior", "parameters", "effects", "noise"};
  return sections;
}

bool read_bound(const std::string& text, double& value) {
  char* end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' && std::isfinite(value);
}

std::string named(const SearchKey& key) {
  return "--search " + key.path + "=" + (key.log ? "log:" : "") + number_text(key.low) + ":" + number_text(key.high);
}

bool fits_schema(SearchKey& key, const KeySpec& spec, std::string& error) {
  const bool number = spec.kind == KeyKind::number || spec.kind == KeyKind::count ||
                      spec.kind == KeyKind::state_numbers || spec.kind == KeyKind::input_numbers;
  if (!number) return true;
  key.whole = spec.kind == KeyKind::count;
  key.multiple = std::max(1u, spec.multiple);
  if (spec.low < spec.high && (key.low < spec.low || key.high > spec.high || (spec.low_open && key.low == spec.low))) {
    error = named(key) + ": the file takes " + number_text(spec.low) + (spec.low_open ? " (not itself)" : "") + " to " +
            number_text(spec.high) + " there; narrow the range";
    return false;
  }
  if (key.whole && std::floor(key.high / key.multiple) <= std::ceil(key.low / key.multiple)) {
    error = named(key) + ": holds fewer than two multiples of " + std::to_string(key.multiple) + "; widen the range";
    return false;
  }
  return true;
}

}  // namespace

double SearchKey::coordinate(double value) const {
  if (log) return std::log(std::max(value, 1e-300) / low) / std::log(high / low);
  return (value - low) / (high - low);
}

double SearchKey::value(double coordinate) const {
  const double v = log ? low * std::exp(coordinate * std::log(high / low)) : low + coordinate * (high - low);
  const double inside = std::min(std::max(v, low), high);
  if (!whole) return inside;
  const double step = multiple, rounded = step * std::round(inside / step);
  return std::min(std::max(rounded, step * std::ceil(low / step)), step * std::floor(high / step));
}

// Six digits: what a reader of the file wants to see, and far finer than an episode can tell apart.
std::string SearchKey::text(double coordinate) const {
  const double v = value(coordinate);
  return whole ? number_text(v) : number_text(std::strtod(format("%.6g", v).c_str(), nullptr));
}

bool parse_search(const std::string& argument, SearchKey& key, std::string& error) {
  const std::size_t equals = argument.find('=');
  std::string range = equals == std::string::npos ? "" : argument.substr(equals + 1);
  key = {};
  key.path = argument.substr(0, equals);
  key.log = range.rfind("log:", 0) == 0;
  if (key.log) range = range.substr(4);
  const std::size_t colon = range.find(':');
  const bool good = !key.path.empty() && colon != std::string::npos && read_bound(range.substr(0, colon), key.low) &&
                    read_bound(range.substr(colon + 1), key.high);
  if (!good) {
    error = "--search " + argument +
            ": is no KEY=LOW:HIGH; write planner.horizon=20:80, or planner.noise_sd.force_N=log:0.5:10 for even steps "
            "of the logarithm";
    return false;
  }
  if (!(key.low < key.high)) {
    error = "--search " + argument + ": the low end is not below the high one; write the smaller number first";
    return false;
  }
  if (key.log && !(key.low > 0)) {
    error = "--search " + argument + ": a logarithm wants a low end above 0; raise it, or leave log: out";
    return false;
  }
  return true;
}

bool check_search(const std::string& text, SearchKey& key, std::string& error) {
  const Words steps = split_path(key.path);
  const Words& sections = open_sections();
  if (std::find(sections.begin(), sections.end(), steps[0]) == sections.end()) {
    const std::string near = nearest(steps[0], sections);
    error = named(key) + ": '" + steps[0] + "' is not searched; " +
            (near.empty() ? "" : "did you mean " + near + "? ") + "sections: " + join(sections) +
            " (limits, safety and the plant are yours to set)";
    return false;
  }
  NumberAt at;
  std::string why;
  const bool there = find_number(text, key.path, at, why);
  const bool free_names = steps[0] == "parameters" || steps[0] == "effects";
  const KeySpec* spec = free_names || steps.size() < 2 ? nullptr : find_key(steps[0], steps[1]);
  if (!free_names && steps.size() >= 2 && !spec) {
    const Words known = keys_of(steps[0]);
    const std::string near = nearest(steps[1], known);
    error = named(key) + ": [" + steps[0] + "] has no key '" + steps[1] + "'; " +
            (near.empty() ? "" : "did you mean " + steps[0] + "." + near + "? ") + "known: " + join(known);
    return false;
  }
  if (spec && !fits_schema(key, *spec, error)) return false;
  if (there) return true;
  std::string scratch = text;
  const bool plain = spec && (spec->kind == KeyKind::number || spec->kind == KeyKind::count) && steps.size() == 2;
  if (plain && set_number(scratch, key.path, key.text(0.5), why)) return true;
  error = named(key) + ": " + why;
  return false;
}

std::vector<SearchKey> default_search(const RobotFile& robot, const std::string& text) {
  std::vector<SearchKey> keys;
  const auto offer = [&](const std::string& path, double down, double up, bool log) {
    NumberAt at;
    std::string error;
    if (!find_number(text, path, at, error) || !(at.value > 0)) return;
    SearchKey key{path, at.value * down, at.value * up, log};
    if (check_search(text, key, error)) keys.push_back(key);
  };
  const std::string planner = planner_names()[robot.config.planner.kind];
  const auto reads = [&](const char* name) {
    const KeySpec* spec = find_key("planner", name);
    return spec && planner_reads(*spec, planner);
  };
  if (reads("horizon")) offer("planner.horizon", 0.5, 2, false);
  for (const std::string& input : robot.inputs) {
    if (reads("noise_sd")) offer("planner.noise_sd." + input, 0.25, 4, true);
    offer("cost.input_weight." + input, 0.1, 10, true);
    offer("cost.input_rate_weight." + input, 0.1, 10, true);
  }
  return keys;
}

}  // namespace tiller::tools::tune
