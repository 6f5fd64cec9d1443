#include "tools/import/figure_writer.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

/// Links that are fixed closer than this to what carries them are drawn as one.
constexpr double kSame_m = 1e-3;

std::string number(double value) { return format("%.9g", std::fabs(value) < 1e-12 ? 0.0 : value); }

std::string triple(const Vec3<double>& v) {
  return "[" + number(v[0]) + ", " + number(v[1]) + ", " + number(v[2]) + "]";
}

double length(const Vec3<double>& v) { return std::sqrt(dot(v, v)); }

std::string quoted(const std::string& name) {
  std::string text = "\"";
  for (const char c : name) text += (c == '"' || c == '\\' ? std::string("\\") : std::string()) + c;
  return text + "\"";
}

/// R = Rz(yaw) Ry(pitch) Rx(roll); looking along z, where only their sum is known, roll is 0.
Vec3<double> rpy_of(const Mat3<double>& r) {
  const double level = std::hypot(r(0, 0), r(1, 0)), pitch = std::atan2(-r(2, 0), level);
  if (level < 1e-9) return {0.0, pitch, std::atan2(-r(0, 1), r(1, 1))};
  return {std::atan2(r(2, 1), r(2, 2)), pitch, std::atan2(r(1, 0), r(0, 0))};
}

class FigureText {
 public:
  FigureText(const Description& robot, const MechanismOptions& options, const Mechanism& mechanism,
             const ModelNames& names)
      : robot_(robot), mechanism_(mechanism), names_(names), moves_(options.base != BaseKind::fixed) {
    for (const LinkText& link : robot.links) link_[link.name] = &link;
    for (const JointText& joint : robot.joints) above_[joint.child] = &joint;
    for (const auto& held : options.held) held_[held.joint] = held.position;
    for (std::size_t i = 0; i < mechanism.bodies.size(); ++i) body_[mechanism.bodies[i].joint] = i;
  }

  std::string write(const std::vector<int>& told) {
    choose(told);
    std::string text =
        "# The stick figure of the pages, from the description's joints; x ahead, z up.\n[figure]\nlinks = [\n";
    for (const NamedFrame& frame : mechanism_.frames)
      if (kept_.count(frame.name) > 0) text += "  { " + (frame.is_link ? row(frame.name) : point(frame.name)) + " },\n";
    return text + "]\n\n";
  }

 private:
  /// From the ends towards the root, which comes first in `frames`.
  void choose(const std::vector<int>& told) {
    for (const int index : told) kept_.insert(mechanism_.frames[static_cast<std::size_t>(index)].name);
    for (const FrameText& frame : robot_.frames)
      if (kept_.count(frame.name) > 0) kept_.insert(frame.link);
    for (std::size_t i = mechanism_.frames.size(); i-- > 0;) {
      const NamedFrame& frame = mechanism_.frames[i];
      if (!frame.is_link) continue;
      const auto joint = above_.find(frame.name);
      const bool root = joint == above_.end();
      if (root || moving(*joint->second) || length(origin(*joint->second).position) > kSame_m) kept_.insert(frame.name);
      if (root || kept_.count(frame.name) == 0) continue;
      kept_.insert(joint->second->parent);
      carries_.insert(joint->second->parent);
    }
    for (const FrameText& frame : robot_.frames)
      if (kept_.count(frame.name) > 0) carries_.insert(frame.link);
  }

  bool moving(const JointText& joint) const { return body_.count(joint.name) > 0; }

  /// Of the child in the parent, where the joint stands at 0, or where it is held.
  Pose origin(const JointText& joint) const {
    const auto held = held_.find(joint.name);
    Pose motion;
    if (held != held_.end() && joint.kind == JointKind::prismatic) motion.position = scaled(held->second, joint.axis);
    if (held != held_.end() && (joint.kind == JointKind::revolute || joint.kind == JointKind::continuous))
      motion.rotation = rotation_about(joint.axis, held->second);
    return joint.origin * motion;
  }

  std::string state_of(const std::string& joint) const {
    const auto body = body_.find(joint);
    if (body == body_.end()) return held_.count(joint) > 0 ? number(held_.at(joint)) : "0";
    const MovingBody& b = mechanism_.bodies[body->second];
    const int leader = b.mimics >= 0 ? b.mimics : static_cast<int>(body->second);
    const auto at = std::find(names_.bodies.begin(), names_.bodies.end(), leader);
    std::string text = names_.positions[static_cast<std::size_t>(at - names_.bodies.begin())];
    if (b.mimics >= 0 && b.mimic_ratio != 1.0) text = number(b.mimic_ratio) + "*" + text;
    if (b.mimics >= 0 && b.mimic_offset != 0.0)
      text += (b.mimic_offset < 0.0 ? " - " : " + ") + number(std::fabs(b.mimic_offset));
    return "\"" + text + "\"";
  }

  std::string row(const std::string& name) const {
    std::string text = "name = " + quoted(name);
    const auto joint = above_.find(name);
    if (joint == above_.end()) return text + base() + end(name);
    const JointText& j = *joint->second;
    text += ", parent = " + quoted(j.parent) + place(origin(j));
    if (moving(j))
      text += ", axis = " + triple(j.axis) + (j.kind == JointKind::prismatic ? ", slide_m = " : ", turn_rad = ") +
              state_of(j.name);
    return text + ", joined = true" + end(name);
  }

  static std::string place(const Pose& pose) {
    const Vec3<double> rpy = rpy_of(pose.rotation);
    return (length(pose.position) > 1e-12 ? ", position_m = " + triple(pose.position) : std::string()) +
           (length(rpy) > 1e-12 ? ", rpy_rad = " + triple(rpy) : std::string());
  }

  /// Where a base that moves is, and a box with its inertia.
  std::string base() const {
    if (!moves_) return "";
    return ", position_m = [" + state_of("base_x") + ", " + state_of("base_y") + ", " + state_of("base_z") +
           "], rpy_rad = [" + state_of("base_roll") + ", " + state_of("base_pitch") + ", " + state_of("base_yaw") + "]";
  }

  bool on_base(const std::string& name) const {
    const auto joint = above_.find(name);
    return joint == above_.end() || (!moving(*joint->second) && on_base(joint->second->parent));
  }

  /// What has no link behind it ends at its centre of mass; the links of a base that moves are even boxes with
  /// their moments of inertia.
  std::string end(const std::string& name) const {
    const LinkText& link = *link_.at(name);
    if (!link.has_inertia || !(link.body.mass_kg > 0.0)) return "";
    const Vec3<double>& com = link.body.com_m;
    if (moves_ && on_base(name)) {
      const Mat3<double>& i = link.body.inertia_kgm2;
      Vec3<double> size;
      for (int k = 0; k < 3; ++k)
        size[static_cast<std::size_t>(k)] = std::sqrt(std::max(
            0.0, 6.0 * (i((k + 1) % 3, (k + 1) % 3) + i((k + 2) % 3, (k + 2) % 3) - i(k, k)) / link.body.mass_kg));
      return ", boxes = [{ at_m = " + triple(com) + ", size_m = " + triple(size) + " }]";
    }
    if (carries_.count(name) > 0 || length(com) < kSame_m) return "";
    return ", lines_m = [[[0, 0, 0], " + triple(com) + "]]";
  }

  std::string point(const std::string& name) const {
    for (const FrameText& frame : robot_.frames)
      if (frame.name == name)
        return "name = " + quoted(name) + ", parent = " + quoted(frame.link) + place(frame.pose) + ", joined = true";
    return "name = " + quoted(name);
  }

  const Description& robot_;
  const Mechanism& mechanism_;
  const ModelNames& names_;
  const bool moves_;
  std::map<std::string, const LinkText*> link_;
  std::map<std::string, const JointText*> above_;
  std::map<std::string, double> held_;
  std::map<std::string, std::size_t> body_;
  std::set<std::string> kept_, carries_;
};

}  // namespace

std::string write_figure(const Description& robot, const MechanismOptions& options, const Mechanism& mechanism,
                         const ModelNames& names, const std::vector<int>& told) {
  return FigureText(robot, options, mechanism, names).write(told);
}

}  // namespace tiller::tools
