#include "tools/import/sphere_outputs.hpp"

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

int find_link(const Mechanism& mechanism, const std::string& link, const std::string& who,
              std::vector<std::string>& errors) {
  const int frame = mechanism.find_frame(link);
  if (frame >= 0) return frame;
  Words names;
  for (const NamedFrame& f : mechanism.frames) names.push_back(f.name);
  const std::string near = nearest(link, names);
  errors.push_back(who + ": no link is called '" + link + "'" +
                   (near.empty() ? "; there are " + join(names) : "; is '" + near + "' meant?"));
  return -1;
}

bool are_neighbours(const Mechanism& mechanism, int a, int b) {
  const auto parent = [&](int body) { return mechanism.bodies[static_cast<std::size_t>(body)].parent; };
  return (a >= 0 && parent(a) == b) || (b >= 0 && parent(b) == a);
}

/// Whether two spheres are to be kept apart; obstacles also from the first body, which a base's spheres cannot be.
bool keep_apart(const Spheres& spheres, const Mechanism& mechanism, const Sphere& a, int body_a, const Sphere& b,
                int body_b) {
  if (body_a == body_b) return false;
  if (b.is_obstacle()) return !a.is_obstacle();
  return !are_neighbours(mechanism, body_a, body_b) && !spheres.are_free_to_touch(a, b);
}

}  // namespace

bool place_spheres(const Spheres& spheres, const Mechanism& mechanism, SphereOutputs& out,
                   std::vector<std::string>& errors) {
  const std::size_t before = errors.size();
  out = {};
  for (const Sphere& sphere : spheres.list) {
    PlacedSphere placed{sphere.name, -1, sphere.at_m};
    if (!sphere.is_obstacle())
      if (const int frame = find_link(mechanism, sphere.link, "sphere " + sphere.name, errors); frame >= 0) {
        const NamedFrame& on = mechanism.frames[static_cast<std::size_t>(frame)];
        placed.body = on.body;
        placed.at = on.pose.rotation * placed.at + on.pose.position;
      }
    out.placed.push_back(placed);
  }
  for (const auto& links : spheres.may_touch)
    for (const std::string& link : {links.first, links.second}) (void)find_link(mechanism, link, "may_touch", errors);
  if (errors.size() != before) return false;
  const int count = static_cast<int>(spheres.list.size());
  const auto at = [](int i) { return static_cast<std::size_t>(i); };
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b < count; ++b)
      if (keep_apart(spheres, mechanism, spheres.list[at(a)], out.placed[at(a)].body, spheres.list[at(b)],
                     out.placed[at(b)].body))
        out.outputs.push_back({apart_output(spheres.list[at(a)].name, spheres.list[at(b)].name), a, b});
  for (int a = 0; spheres.has_floor && a < count; ++a)
    if (out.placed[at(a)].body >= 0) out.outputs.push_back({height_output(spheres.list[at(a)].name), a, -1});
  if (count > 0 && out.outputs.empty())
    errors.push_back(
        "spheres: all of them are on one link or on neighbours, which always touch; put one on a link further along, or add "
        "an obstacle or a floor");
  return errors.size() == before;
}

}  // namespace tiller::tools
