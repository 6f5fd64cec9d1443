#include "tools/base/spheres.hpp"

#include <algorithm>
#include <sstream>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

bool begins_with(const std::string& text, const std::string& head) { return text.compare(0, head.size(), head) == 0; }

}  // namespace

bool Spheres::are_free_to_touch(const Sphere& a, const Sphere& b) const {
  return std::any_of(may_touch.begin(), may_touch.end(), [&](const auto& links) {
    return (links.first == a.link && links.second == b.link) || (links.first == b.link && links.second == a.link);
  });
}

std::string sphere_mark(const Sphere& sphere) {
  std::string text =
      sphere.is_obstacle() ? "// obstacle " + sphere.name : "// sphere " + sphere.name + " on " + sphere.link;
  text += " at";
  for (const double x : sphere.at_m) text += " " + number_text(x + 0.0);
  return text;
}

std::string clearance_text(const Spheres& spheres) {
  std::string text =
      "[cost.clearance]\n# centres are compiled into the model: whoever moves one runs `tiller import ... --model-only`, and is told\n"
      "margin_m = " +
      number_text(spheres.margin_m) + "\nweight = " + number_text(spheres.weight) + "\n";
  if (spheres.has_floor) text += "floor_m = " + number_text(spheres.floor_m) + "\n";
  const auto row = [](const char* key, const std::string& name, const Sphere& s) {
    return std::string("  { ") + key + " = \"" + name + "\", at_m = [" + number_text(s.at_m[0]) + ", " +
           number_text(s.at_m[1]) + ", " + number_text(s.at_m[2]) + "], radius_m = " + number_text(s.radius_m) +
           " },\n";
  };
  std::string links, obstacles, pairs;
  for (const Sphere& s : spheres.list)
    (s.is_obstacle() ? obstacles : links) += s.is_obstacle() ? row("name", s.name, s) : row("link", s.link, s);
  for (const auto& [a, b] : spheres.may_touch) pairs += (pairs.empty() ? "[\"" : ", [\"") + a + "\", \"" + b + "\"]";
  text += "spheres = [\n" + links + "]\n";
  if (!obstacles.empty()) text += "obstacles = [\n" + obstacles + "]\n";
  if (!pairs.empty()) text += "may_touch = [" + pairs + "]\n";
  return text + "\n";
}

std::string may_touch_mark(const std::pair<std::string, std::string>& links) {
  return "// may touch: " + links.first + ", " + links.second;
}

std::vector<std::string> all_marks(const Spheres& spheres) {
  std::vector<std::string> marks;
  for (const Sphere& sphere : spheres.list) marks.push_back(sphere_mark(sphere));
  for (const auto& links : spheres.may_touch) marks.push_back(may_touch_mark(links));
  if (spheres.has_floor) marks.push_back(floor_mark());
  return marks;
}

std::vector<std::string> marks_in(const std::string& header) {
  std::vector<std::string> marks;
  std::istringstream lines(header);
  for (std::string line; std::getline(lines, line);)
    if (begins_with(line, "// sphere ") || begins_with(line, "// obstacle ") || begins_with(line, "// may touch: ") ||
        line == floor_mark())
      marks.push_back(line);
  return marks;
}

std::string command_in(const std::string& header) {
  std::istringstream lines(header);
  for (std::string line; std::getline(lines, line);)
    if (begins_with(line, command_mark())) return line.substr(command_mark().size());
  return "";
}

}  // namespace tiller::tools
