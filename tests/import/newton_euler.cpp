#include "newton_euler.hpp"

namespace tiller_test {

using namespace tiller::tools;

/// A link's motion in the world.
struct NewtonEuler::Moving {
  Pose pose;
  Vec3<double> turn{}, turn_rate{};      // angular velocity and its derivative
  Vec3<double> speed{}, acceleration{};  // of the origin
  Vec3<double> axis{};                   // of the joint before it
  const JointText* joint = nullptr;
};

namespace {

double value_of(const NewtonEuler::Values& values, const std::string& joint) {
  const auto found = values.find(joint);
  return found == values.end() ? 0.0 : found->second;
}

}  // namespace

std::map<std::string, NewtonEuler::Moving> NewtonEuler::all(const Values& q, const Values& v, const Values& a) const {
  std::map<std::string, Moving> links;
  for (const LinkText& link : robot_.links) {
    bool is_root = true;
    for (const JointText& joint : robot_.joints) is_root = is_root && joint.child != link.name;
    if (is_root) links[link.name] = {};
  }
  // joints in any order: again until nothing is new
  for (bool grown = true; grown;) {
    grown = false;
    for (const JointText& joint : robot_.joints) {
      if (links.count(joint.parent) == 0 || links.count(joint.child) > 0) continue;
      const Moving& up = links[joint.parent];
      Moving m;
      m.joint = &joint;
      const double position = value_of(q, joint.name), rate = value_of(v, joint.name), gain = value_of(a, joint.name);
      Pose motion;
      const bool slides = joint.kind == JointKind::prismatic, turns = joint.kind != JointKind::fixed && !slides;
      if (slides) motion.position = scaled(position, joint.axis);
      if (turns) motion.rotation = rotation_about(joint.axis, position);
      m.pose = up.pose * joint.origin * motion;
      m.axis = (up.pose * joint.origin).rotation * joint.axis;
      const Vec3<double> arm = m.pose.position - up.pose.position;
      const double turn = turns ? rate : 0.0, turn_gain = turns ? gain : 0.0;
      const double slide = slides ? rate : 0.0, slide_gain = slides ? gain : 0.0;
      m.turn = up.turn + scaled(turn, m.axis);
      m.turn_rate = up.turn_rate + scaled(turn_gain, m.axis) + cross(up.turn, scaled(turn, m.axis));
      m.speed = up.speed + cross(up.turn, arm) + scaled(slide, m.axis);
      m.acceleration = up.acceleration + cross(up.turn_rate, arm) + cross(up.turn, cross(up.turn, arm)) +
                       scaled(2.0 * slide, cross(up.turn, m.axis)) + scaled(slide_gain, m.axis);
      links[joint.child] = m;
      grown = true;
    }
  }
  return links;
}

NewtonEuler::Values NewtonEuler::forces(const Values& q, const Values& v, const Values& a,
                                        const Vec3<double>& gravity) const {
  const std::map<std::string, Moving> links = all(q, v, a);
  Values out;
  for (const JointText& joint : robot_.joints) {
    if (joint.kind == JointKind::fixed) continue;
    const Moving& carried = links.at(joint.child);
    Vec3<double> force{}, moment{};  // on everything behind the joint, about its origin
    for (const LinkText& link : robot_.links) {
      bool behind = false;
      for (const JointText* up = links.at(link.name).joint; up != nullptr; up = links.at(up->parent).joint)
        behind = behind || up == &joint;
      if (!behind || !link.has_inertia) continue;
      const Moving& m = links.at(link.name);
      const Vec3<double> arm = m.pose.rotation * link.body.com_m;
      const Mat3<double> inertia = m.pose.rotation * link.body.inertia_kgm2 * m.pose.rotation.transposed();
      const Vec3<double> centre = m.acceleration + cross(m.turn_rate, arm) + cross(m.turn, cross(m.turn, arm));
      const Vec3<double> f = scaled(link.body.mass_kg, centre - gravity);
      force = force + f;
      moment = moment + inertia * m.turn_rate + cross(m.turn, inertia * m.turn) +
               cross(m.pose.position + arm - carried.pose.position, f);
    }
    const double own = dot(carried.axis, joint.kind == JointKind::prismatic ? force : moment);
    out[joint.name] = own + joint.armature * value_of(a, joint.name);
  }
  return out;
}

Vec3<double> NewtonEuler::origin_of(const std::string& link, const Values& q) const {
  return all(q, {}, {}).at(link).pose.position;
}

}  // namespace tiller_test
