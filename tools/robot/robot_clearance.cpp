// [cost.clearance]: which distances of the model's spheres cost what, and whether they are this file's spheres.

#include <algorithm>
#include <fstream>
#include <sstream>

#include "tools/robot/clearance_section.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

const std::string kMayTouch = "// may touch: ";

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

/// Centres are the model's: where they are not this file's, the model is that of other spheres. It may have more of
/// them, and keep apart what may touch here.
bool fits_model(SectionReader& cost, const RobotFile& robot, const ClearanceSection& section) {
  FileErrors& errors = cost.errors();
  const std::string path = model_path(robot.model_request);
  const std::string header = path.empty() ? "" : text_of(path);
  const std::vector<std::string> compiled = marks_in(header);
  const std::string command = command_in(header);
  const std::string remedy =
      (command.empty()
           ? std::string("write the model anew: `tiller import DESCRIPTION -o FOLDER --model-only`, with the "
                         "options that it had")
           : "write the model anew: `" + command + " --model-only`") +
      " (this file stays as it is)";
  const toml::node& whole = *cost.node("clearance");
  const std::string file = path.empty() ? robot.model_request.name : path.substr(path.find_last_of('/') + 1);
  if (compiled.empty()) {
    errors.at_table(whole, "cost.clearance", "the model (" + file + ") knows no spheres", remedy);
    return false;
  }
  const auto has = [](const std::vector<std::string>& list, const std::string& mark) {
    return std::find(list.begin(), list.end(), mark) != list.end();
  };
  const std::size_t before = errors.list().size();
  const std::vector<std::string> ours = all_marks(section.spheres);
  for (std::size_t i = 0; i < section.spheres.list.size(); ++i)
    if (const Sphere& sphere = section.spheres.list[i]; !has(compiled, sphere_mark(sphere)))
      errors.at(*section.nodes[i], "cost.clearance." + std::string(sphere.is_obstacle() ? "obstacles" : "spheres"),
                "the model (" + file + ") has no " + sphere_mark(sphere).substr(3), remedy);
  const auto lack = [&](const std::string& what) { errors.at_table(whole, "cost.clearance", what, remedy); };
  if (section.spheres.has_floor && !has(compiled, floor_mark()))
    lack("the model (" + file + ") tells no heights over a floor");
  for (const std::string& mark : compiled)
    if (mark.compare(0, kMayTouch.size(), kMayTouch) == 0 && !has(ours, mark))
      lack("the model (" + file +
           ") does not keep these apart, and may_touch has them no more: " + mark.substr(kMayTouch.size()));
  return errors.list().size() == before;
}

}  // namespace

std::vector<ClearanceOutput> read_clearance(SectionReader& cost, const RobotFile& robot,
                                            std::vector<tiller_output_cost_t>& costs) {
  std::vector<ClearanceOutput> bounded;
  const toml::table* table = cost.subtable("clearance");
  ClearanceSection section;
  if (!table || !read_clearance_section(cost.errors(), *table, section) || !fits_model(cost, robot, section))
    return bounded;
  const Spheres& spheres = section.spheres;
  if (!(spheres.weight > 0.0)) return bounded;
  const auto bound = [&](const std::string& output, double radii_m, double at_m) {
    const int index = index_of(robot.names.outputs, output);
    if (index < 0) return;
    tiller_output_cost_t& out = costs[static_cast<std::size_t>(index)];
    out.low = at_m + radii_m + spheres.margin_m;
    out.bound_weight = spheres.weight;
    bounded.push_back({output, at_m + radii_m, spheres.margin_m});
  };
  const std::vector<Sphere>& list = spheres.list;
  for (std::size_t a = 0; a < list.size(); ++a) {
    for (std::size_t b = a + 1; b < list.size(); ++b)
      if (!spheres.are_free_to_touch(list[a], list[b]))
        bound(apart_output(list[a].name, list[b].name), list[a].radius_m + list[b].radius_m, 0.0);
    if (spheres.has_floor) bound(height_output(list[a].name), list[a].radius_m, spheres.floor_m);
  }
  return bounded;
}

}  // namespace tiller::tools
