#include "tools/robot/clearance_file.hpp"

#include <cctype>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "tools/robot/clearance_section.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

/// As a name within an output's: letters, digits, underscores.
std::string word_of(const std::string& name) {
  std::string out;
  for (const char c : name) out += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  return out;
}

class Reader {
 public:
  Reader(FileErrors& errors, const toml::table& table, ClearanceSection& out)
      : errors_(errors), section_(errors, "cost.clearance", "cost.clearance", &table), out_(out) {}

  void read() {
    section_.refuse_unknown();
    if (!section_.has("weight")) section_.missing("weight", "write what a metre too near costs, in 1/m^2, e.g. 1e5");
    if (!section_.has("spheres"))
      section_.missing("spheres", "write spheres = [ { link = \"..\", at_m = [x, y, z], radius_m = .. } ]");
    out_.spheres.margin_m = section_.number("margin_m").value_or(0.0);
    out_.spheres.weight = section_.number("weight").value_or(0.0);
    out_.spheres.has_floor = section_.has("floor_m");
    out_.spheres.floor_m = section_.number("floor_m").value_or(0.0);
    each("spheres", [&](SectionReader& entry) { return entry_of(entry, "link", true); });
    each("obstacles", [&](SectionReader& entry) { return entry_of(entry, "name", false); });
    may_touch();
  }

 private:
  template <class Read>
  void each(const char* key, const Read& read) {
    const toml::node* node = section_.node(key);
    if (!node) return;
    const toml::array* list = node->as_array();
    if (!list) return section_.error(key, "is " + kind_text(*node), "write a list [ { .. }, { .. } ]");
    std::size_t index = 0;
    for (const toml::node& element : *list) {
      ++index;
      const std::string path = section_.path_of(std::string(key) + "[" + std::to_string(index) + "]");
      if (!element.is_table()) {
        errors_.at(element, path, "is " + kind_text(element), "write a table { .. }");
        continue;
      }
      SectionReader entry(errors_, std::string("cost.clearance.") + key + "[]", path, element.as_table());
      const std::size_t before = errors_.list().size();
      const Sphere sphere = read(entry);
      if (errors_.list().size() != before) continue;
      if (!taken_.insert(sphere.name).second)
        entry.error("name", "is taken by another sphere or obstacle", "write another name");
      out_.spheres.list.push_back(sphere);
      out_.nodes.push_back(&element);
    }
  }

  Sphere entry_of(SectionReader& entry, const char* key, bool on_link) {
    entry.refuse_unknown();
    Sphere sphere;
    for (const char* needed : {key, "at_m", "radius_m"})
      if (!entry.has(needed)) entry.missing(needed, find_key(on_link ? kSpheres : kObstacles, needed)->help);
    const std::string name = entry.text(key).value_or("");
    if (entry.has(key) && name.empty()) entry.error(key, "is empty", "write a name");
    if (entry.has("at_m")) (void)read_triple(entry, "at_m", sphere.at_m);
    sphere.radius_m = entry.number("radius_m").value_or(1.0);
    sphere.name = word_of(name);
    if (on_link) {
      sphere.link = name;
      sphere.name += "_" + std::to_string(++on_link_[name]);
    } else if (sphere.name != name) {
      entry.error(key, "is no name", "use letters, digits and underscores");
    }
    return sphere;
  }

  void may_touch() {
    const toml::node* node = section_.node("may_touch");
    if (!node) return;
    const char* remedy = "write a list of pairs, e.g. [[\"base\", \"forearm\"]]";
    const toml::array* list = node->as_array();
    if (!list) return section_.error("may_touch", "is " + kind_text(*node), remedy);
    for (const toml::node& element : *list) {
      const toml::array* pair = element.as_array();
      const bool good = pair && pair->size() == 2 && (*pair)[0].is_string() && (*pair)[1].is_string();
      if (!good)
        errors_.at(element, "cost.clearance.may_touch", "is no pair of links", remedy);
      else
        out_.spheres.may_touch.emplace_back(*(*pair)[0].value<std::string>(), *(*pair)[1].value<std::string>());
    }
  }

  static constexpr const char *kSpheres = "cost.clearance.spheres[]", *kObstacles = "cost.clearance.obstacles[]";
  FileErrors& errors_;
  SectionReader section_;
  ClearanceSection& out_;
  std::map<std::string, int> on_link_;
  std::set<std::string> taken_;
};

}  // namespace

bool read_clearance_section(FileErrors& errors, const toml::table& table, ClearanceSection& out) {
  const std::size_t before = errors.list().size();
  Reader(errors, table, out).read();
  return errors.list().size() == before;
}

bool read_sphere_file(const std::string& path, Spheres& spheres, std::vector<std::string>& problems) {
  std::ifstream file(path);
  std::stringstream text;
  if (file) text << file.rdbuf();
  if (!file) {
    problems.push_back(path + ": cannot be read");
    return false;
  }
  FileErrors errors(path, text.str());
  ClearanceSection section;
  try {
    const std::string content = text.str();
    const toml::table root = toml::parse(std::string_view(content), std::string_view(path));
    const toml::node* node = root["cost"]["clearance"].node();
    if (node && !node->is_table())
      errors.at(*node, "cost.clearance", "is " + kind_text(*node), "write a section [cost.clearance]");
    else if (node)
      (void)read_clearance_section(errors, *node->as_table(), section);
  } catch (const toml::parse_error& error) {
    errors.at_line(static_cast<int>(error.source().begin.line), "TOML", std::string(error.description()),
                   "correct the syntax (toml.io)");
  }
  spheres = section.spheres;
  if (errors.empty()) return true;
  std::istringstream lines(errors.text());
  for (std::string line; std::getline(lines, line);) problems.push_back(line);
  return false;
}

}  // namespace tiller::tools
