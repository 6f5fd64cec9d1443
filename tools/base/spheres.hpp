#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

namespace tiller::tools {

/// Spheres that stand for a robot's links and for what stands around it, as [cost.clearance] has them. Centres are
/// compiled into the model as outputs; radii, margins and weights are the robot file's alone.
struct Sphere {
  std::string name;  ///< "forearm_1"; an obstacle's own
  std::string link;  ///< empty: an obstacle, which stands in the base's axes
  std::array<double, 3> at_m{};
  double radius_m = 0.0;

  bool is_obstacle() const { return link.empty(); }
};

struct Spheres {
  std::vector<Sphere> list;                                    ///< those on links first
  std::vector<std::pair<std::string, std::string>> may_touch;  ///< links whose spheres are not kept apart
  bool has_floor = false;
  double floor_m = 0.0, margin_m = 0.03, weight = 1e5;

  bool empty() const { return list.empty(); }
  bool are_free_to_touch(const Sphere& a, const Sphere& b) const;
};

/// The section of a robot file that says the same.
std::string clearance_text(const Spheres& spheres);

/// The outputs that models tell of them: the distance of two centres, and a centre's height over the base's origin.
inline std::string apart_output(const std::string& a, const std::string& b) { return "apart_" + a + "_" + b + "_m"; }
inline std::string height_output(const std::string& sphere) { return "height_" + sphere + "_m"; }

/// What an imported header says of the spheres that it was made with: a comment line each, which a robot file's spheres
/// must make too.
std::string sphere_mark(const Sphere& sphere);
std::string may_touch_mark(const std::pair<std::string, std::string>& links);
inline std::string floor_mark() { return "// floor"; }
std::vector<std::string> all_marks(const Spheres& spheres);
/// The marks of a header's text, and the line that tells how it was written; empty: none.
std::vector<std::string> marks_in(const std::string& header);
std::string command_in(const std::string& header);
/// The head of that line.
inline std::string command_mark() { return "// written by: "; }

}  // namespace tiller::tools
