#include "tools/import/mechanism.hpp"

#include <fnmatch.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "tools/base/text.hpp"
#include "tools/import/articulated_body.hpp"

namespace tiller::tools {

std::vector<int> Mechanism::free_joints() const {
  std::vector<int> joints;
  for (std::size_t i = 0; i < bodies.size(); ++i)
    if (bodies[i].mimics < 0) joints.push_back(static_cast<int>(i));
  return joints;
}

int Mechanism::find_frame(const std::string& wanted) const {
  for (std::size_t i = 0; i < frames.size(); ++i)
    if (frames[i].name == wanted) return static_cast<int>(i);
  return -1;
}

namespace {

/// Accelerations that no motor with a rotor reaches.
constexpr double kFast_rad_s2 = 5000.0, kFast_m_s2 = 1000.0;

/// Below this, lengths and sines are rounding of the file's numbers.
constexpr double kNothing = 1e-13;

double clean(double value) { return std::fabs(value) < kNothing ? 0.0 : value; }

/// A body while the tree grows: its frame is that of the link behind the joint.
struct RawBody {
  MovingBody body;
  Pose origin;          // of the link's frame in the parent body's, at joint position 0
  Vec3<double> axis{};  // in the link's frame
  Pose aligned;         // the body's own frame in the link's
};

Pose frame_of(const Vec3<double>& z, const Vec3<double>& x, const Vec3<double>& at) {
  const Vec3<double> y = cross(z, x);
  Pose pose;
  for (int r = 0; r < 3; ++r) {
    const auto i = static_cast<std::size_t>(r);
    pose.rotation(r, 0) = x[i];
    pose.rotation(r, 1) = y[i];
    pose.rotation(r, 2) = z[i];
  }
  pose.position = at;
  return pose;
}

/// A unit vector at right angles to `z`: the link's own x where that is one.
Vec3<double> any_normal(const Vec3<double>& z) {
  for (const Vec3<double>& tried : {Vec3<double>{1, 0, 0}, Vec3<double>{0, 1, 0}}) {
    const Vec3<double> rest = tried - scaled(dot(tried, z), z);
    const double length = std::sqrt(dot(rest, rest));
    if (length > 0.5) return scaled(1.0 / length, rest);
  }
  return {0, 0, 1};
}

/// The frame of a body in that of its link: z along the joint, x along the common normal of this axis and the
/// next one's, the origin where the normal stands on this axis. Of one child, then, only four numbers are not zero.
Pose align(const Vec3<double>& z, const Vec3<double>* next_z, const Vec3<double>* next_at) {
  if (next_z == nullptr) return frame_of(z, any_normal(z), {});
  const Vec3<double> normal = cross(z, *next_z);
  const double sine = std::sqrt(dot(normal, normal));
  if (sine < 1e-9) {  // parallel: the normal goes through this link's origin
    const Vec3<double> across = *next_at - scaled(dot(*next_at, z), z);
    const double distance = std::sqrt(dot(across, across));
    return frame_of(z, distance > 1e-9 ? scaled(1.0 / distance, across) : any_normal(z), {});
  }
  const Vec3<double> x = scaled(1.0 / sine, normal);
  // foot on this axis: s z + a x = at + t next_z
  const double s = dot(cross(*next_at, *next_z), normal) / (sine * sine);
  return frame_of(z, x, scaled(s, z));
}

JointFrame decompose(const Pose& pose) {
  JointFrame f;
  const Mat3<double>& r = pose.rotation;
  const Vec3<double>& p = pose.position;
  // R = Rz(azimuth) Rx(tilt) Rz(turn): its third column is (sin a sin t, -cos a sin t, cos t)
  const double sine = std::hypot(r(0, 2), r(1, 2));
  if (sine < kNothing) {
    f.tilt_rad = r(2, 2) > 0.0 ? 0.0 : M_PI;
    // only azimuth and turn together are known: along x is where the next axis stands
    f.azimuth_rad = std::hypot(p[0], p[1]) > kNothing ? std::atan2(p[1], p[0]) : 0.0;
  } else {
    f.azimuth_rad = std::atan2(r(0, 2), -r(1, 2));
    f.tilt_rad = std::atan2(sine, r(2, 2));
    // the other half turn is as good, and often is no turn at all
    if (std::fabs(f.azimuth_rad) > M_PI / 2) {
      f.azimuth_rad += f.azimuth_rad > 0.0 ? -M_PI : M_PI;
      f.tilt_rad = -f.tilt_rad;
    }
  }
  f.azimuth_rad = clean(f.azimuth_rad);
  if (std::fabs(std::fabs(f.azimuth_rad) - M_PI) < kNothing && sine < kNothing) {
    f.azimuth_rad = 0.0;
  }
  const Mat3<double> before = rotation_about({0, 0, 1}, f.azimuth_rad) * rotation_about({1, 0, 0}, f.tilt_rad);
  const Mat3<double> turn = before.transposed() * r;
  f.turn_rad = clean(std::atan2(turn(1, 0), turn(0, 0)));
  f.tilt_rad = clean(f.tilt_rad);
  const Vec3<double> along = rotation_about({0, 0, 1}, f.azimuth_rad).transposed() * p;
  f.x_m = clean(along[0]);
  const Vec3<double> rest = rotation_about({1, 0, 0}, f.tilt_rad).transposed() * Vec3<double>{0.0, along[1], along[2]};
  f.y_m = clean(rest[1]);
  f.z_m = clean(rest[2]);
  return f;
}

class Builder {
 public:
  Builder(const Description& robot, const MechanismOptions& options, Mechanism& out, std::vector<std::string>& errors)
      : robot_(robot), options_(options), out_(out), errors_(errors) {}

  bool run() {
    out_ = {};
    out_.name = robot_.name;
    out_.path = robot_.path;
    out_.notes = robot_.notes;
    out_.left_out = robot_.left_out;
    out_.idle_drives = robot_.idle_drives;
    for (const LinkText& link : robot_.links) link_[link.name] = &link;
    for (const JointText& joint : robot_.joints) below_[joint.parent].push_back(&joint);
    check_held();
    check_armature();
    const std::string root = find_root();
    if (!errors_.empty()) return false;
    add_base(root);
    check_reached();
    if (!errors_.empty()) return false;
    check_ties();
    resolve_mimics();
    place_frames();
    check_masses();
    take_gravity();
    if (options_.servos && laws_ == 0)
      errors_.push_back("--servos: " + robot_.path +
                        " has no actuator whose law can be taken (a position or velocity servo alone at its joint); "
                        "leave it out");
    if (errors_.empty()) note_light_joints();
    if (errors_.empty() && out_.bodies.empty())
      errors_.push_back(robot_.path + ": nothing moves: every joint is fixed");
    if (errors_.empty()) add_points();
    return errors_.empty();
  }

 private:
  void error(int line, const std::string& text) { errors_.push_back(at_line(line) + ": " + text); }
  std::string at_line(int line) const { return line > 0 ? robot_.path + ":" + std::to_string(line) : robot_.path; }

  void check_held() {
    for (const MechanismOptions::Held& held : options_.held) {
      Words names = base_joints();
      for (const JointText& j : robot_.joints) names.push_back(j.name);
      if (std::find(names.begin(), names.end(), held.joint) == names.end()) {
        const std::string near = nearest(held.joint, names);
        errors_.push_back("--hold " + held.joint + ": " + robot_.path + " has no such joint" +
                          (near.empty() ? "" : "; is '" + near + "' meant?"));
      }
      held_[held.joint] = held.position;
    }
  }

  void check_armature() {
    for (const MechanismOptions::Armature& a : options_.armature) {
      Words names;
      for (const JointText& j : robot_.joints) names.push_back(j.name);
      if (a.joint == "*" || std::find(names.begin(), names.end(), a.joint) != names.end()) continue;
      const std::string near = nearest(a.joint, names);
      errors_.push_back("--armature " + a.joint + ": " + robot_.path + " has no such joint" +
                        (near.empty() ? "" : "; is '" + near + "' meant?"));
    }
  }

  std::string find_root() {
    std::map<std::string, const JointText*> above;
    for (const JointText& joint : robot_.joints) {
      if (above.count(joint.child) > 0)
        error(joint.line, "link '" + joint.child + "' hangs on two joints, '" + above[joint.child]->name + "' and '" +
                              joint.name + "'; a closed chain is no tree: cut it at one of them");
      above[joint.child] = &joint;
    }
    std::vector<std::string> roots;
    for (const LinkText& link : robot_.links)
      if (above.count(link.name) == 0) roots.push_back(link.name);
    if (roots.size() == 1) return roots[0];
    if (roots.empty())
      errors_.push_back(robot_.path + ": every link hangs on another: the joints go in a circle");
    else
      errors_.push_back(robot_.path + ": " + std::to_string(roots.size()) + " links hang on nothing (" + join(roots) +
                        "); a robot has one root: add fixed joints between them");
    return "";
  }

  Words base_joints() const {
    if (options_.base == BaseKind::planar) return {"base_x", "base_y", "base_yaw"};
    if (options_.base == BaseKind::free) return {"base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll"};
    return {};
  }

  /// The base, behind the joints that carry it where it moves.
  void add_base(const std::string& root) {
    static const std::map<std::string, Vec3<double>> axes = {{"base_x", {1, 0, 0}},     {"base_y", {0, 1, 0}},
                                                             {"base_z", {0, 0, 1}},     {"base_yaw", {0, 0, 1}},
                                                             {"base_pitch", {0, 1, 0}}, {"base_roll", {1, 0, 0}}};
    int at = -1;
    Pose stands;  // what is held since the last joint that moves
    for (const std::string& name : base_joints()) {
      const Vec3<double>& axis = axes.at(name);
      const bool prismatic = name.size() == std::string("base_x").size();
      if (const auto held = held_.find(name); held != held_.end()) {
        Pose motion;
        if (prismatic)
          motion.position = scaled(held->second, axis);
        else
          motion.rotation = rotation_about(axis, held->second);
        stands = stands * motion;
        continue;
      }
      RawBody raw;
      raw.body.joint = name;
      raw.body.parent = at;
      raw.body.prismatic = prismatic;
      raw.body.low = -INFINITY;
      raw.body.high = raw.body.effort = raw.body.speed = INFINITY;
      raw.body.actuated = false;
      raw.body.wraps = !prismatic;
      raw.origin = stands;
      raw.axis = axis;
      raw_.push_back(raw);
      at = static_cast<int>(raw_.size()) - 1;
      stands = Pose{};
    }
    add_link(root, at, stands, 0);
  }

  void add_link(const std::string& name, int body, const Pose& pose, int depth) {
    reached_.insert(name);
    if (depth > 1000) return error(0, "the joints go in a circle through link '" + name + "'");
    const LinkText& link = *link_.at(name);
    frames_.push_back({name, body, pose});
    if (link.has_inertia && body >= 0) {
      check_inertia(link);
      raw_[static_cast<std::size_t>(body)].body.links.push_back({name, moved(link.body, pose)});
    }
    const auto below = below_.find(name);
    if (below == below_.end()) return;
    for (const JointText* joint : below->second) add_joint(*joint, body, pose, depth);
  }

  /// Whether anything moves that does not hang on `joint`.
  bool moves_beside(const JointText& joint) const {
    std::set<std::string> behind{joint.child};
    std::vector<std::string> open{joint.child};
    while (!open.empty()) {
      const auto below = below_.find(open.back());
      open.pop_back();
      if (below == below_.end()) continue;
      for (const JointText* next : below->second)
        if (behind.insert(next->child).second) open.push_back(next->child);
    }
    return std::any_of(robot_.joints.begin(), robot_.joints.end(), [&](const JointText& other) {
      return &other != &joint && other.kind != JointKind::fixed && behind.count(other.parent) == 0;
    });
  }

  /// Why a joint cannot be one of a model's, and what to do; empty: it can.
  std::string unreadable(const JointText& joint, int body) const {
    const bool floats = joint.kind == JointKind::floating;
    if (joint.kind == JointKind::ball)
      return "joint '" + joint.name + "' is a ball; write it as three hinges, or hold it: --hold " + joint.name;
    if (!floats && joint.kind != JointKind::planar) return "";
    const std::string is = "joint '" + joint.name + "' is " + (floats ? "floating" : "planar");
    if (body < 0 && !moves_beside(joint))
      return is + "; make it fixed and import with --base " + (floats ? "free" : "planar");
    return is +
           ", which only the joint that carries the whole robot may be; write it as prismatic and revolute joints, or "
           "hold it: --hold " +
           joint.name;
  }

  void add_joint(const JointText& joint, int body, const Pose& pose, int depth) {
    const auto held = held_.find(joint.name);
    if (joint.kind == JointKind::fixed || held != held_.end()) {
      Pose motion;
      const double by = held != held_.end() ? held->second : 0.0;
      if (joint.kind == JointKind::prismatic) motion.position = scaled(by, joint.axis);
      if (joint.kind == JointKind::revolute || joint.kind == JointKind::continuous)
        motion.rotation = rotation_about(joint.axis, by);
      return add_link(joint.child, body, pose * joint.origin * motion, depth + 1);
    }
    if (const std::string why = unreadable(joint, body); !why.empty()) {
      error(joint.line, why);
      return add_link(joint.child, body, pose * joint.origin, depth + 1);  // what hangs on it is connected all the same
    }
    RawBody raw;
    MovingBody& b = raw.body;
    b.joint = joint.name;
    b.parent = body;
    b.prismatic = joint.kind == JointKind::prismatic;
    b.wraps = joint.kind == JointKind::continuous;
    b.low = joint.low;
    b.high = joint.high;
    b.effort = joint.effort;
    b.speed = joint.speed;
    b.damping = joint.damping;
    b.friction = joint.friction;
    b.stiffness = joint.stiffness;
    b.rest = joint.rest;
    b.start = joint.start;
    b.actuated = joint.actuated;
    b.armature = joint.armature;
    take_law(joint, b);
    for (const MechanismOptions::Armature& a : options_.armature)
      if (a.joint == joint.name || (a.joint == "*" && joint.armature == 0.0 && joint.mimics.empty()))
        b.armature = a.inertia;
    b.line = joint.line;
    raw.origin = pose * joint.origin;
    raw.axis = joint.axis;
    raw_.push_back(raw);
    add_link(joint.child, static_cast<int>(raw_.size()) - 1, Pose{}, depth + 1);
  }

  /// Without a stiffness a law is friction and a constant force beside an input that is a force.
  void take_law(const JointText& joint, MovingBody& b) {
    if (joint.law.kind.empty() || !options_.servos) {
      for (const std::string& told : joint.law_told) out_.left_out.push_back(told);
      return;
    }
    b.law = joint.law;
    ++laws_;
    if (b.has_goal()) {
      const double span = std::max(0.1, b.goal_high() - b.goal_low());
      b.effort = std::isfinite(joint.law.limit) ? joint.law.limit : joint.law.stiffness * span;
      return;
    }
    b.damping += joint.law.damping;
    b.offset = joint.law.goal_at_zero;
    const double most = std::max(std::fabs(joint.law.low - b.offset), std::fabs(joint.law.high - b.offset));
    b.effort = std::isfinite(most) ? most : joint.effort;
    if (std::isfinite(joint.law.limit))
      out_.left_out.push_back(joint.law.kind +
                              ": the limit of its force counts for input and damping together, which is not read");
  }

  /// A body's mass is above zero and its principal moments are those of some distribution of mass: none is larger than
  /// the two others together.
  void check_inertia(const LinkText& link) {
    const RigidBody& b = link.body;
    if (options_.any_inertia) return;
    const Vec3<double> moment = principal_moments(b.inertia_kgm2);
    const double most = moment[2], slack = 1e-6 * most + 1e-15;
    const auto numbers = [&] {
      return format("principal moments %.4g, %.4g, %.4g kgm2", moment[0], moment[1], moment[2]);
    };
    if (moment[0] < -slack)
      error(link.line, "the inertia of link '" + link.name + "' is not positive (" + numbers() +
                           "); correct it, or take it as it is with --any-inertia");
    else if (most > moment[0] + moment[1] + slack)
      notes_of_shape_.push_back({&link, numbers()});
  }

  void check_reached() {
    for (const LinkText& link : robot_.links)
      if (reached_.count(link.name) == 0)
        error(link.line, "link '" + link.name + "' is not connected with the root: the joints go in a circle");
  }

  /// What ties two links is idle where they are one body already, and closes a chain otherwise.
  void check_ties() {
    const auto body_of = [&](const std::string& link) {
      const auto found =
          std::find_if(frames_.begin(), frames_.end(), [&](const NamedFrame& f) { return f.name == link; });
      return found != frames_.end() ? found->body : -1;
    };
    for (const TieText& tie : robot_.ties) {
      const int a = body_of(tie.link_a), b = body_of(tie.link_b);
      if (a == b) continue;
      const MovingBody& last = raw_[static_cast<std::size_t>(std::max(a, b))].body;
      error(0,
            tie.kind + " '" + tie.name + "' ties link '" + tie.link_a + "' to '" + tie.link_b +
                "': a closed chain is no tree; take it out, or hold the joints between them, for example --hold " +
                last.joint +
                ", or where the others' positions are straight lines of one joint's (a parallelogram) couple them by "
                "<equality><joint>, which is exact");
    }
  }

  void take_gravity() {
    const Vec3<double>& g = robot_.gravity_m_s2;
    out_.gravity_m_s2 = {g[0], 0.0, g[2]};
    if (g[1] != 0.0)
      out_.notes.push_back(robot_.path + format(": gravity along y (%.4g m/s2) is left out: turn the robot so that "
                                                "gravity has x and z alone",
                                                g[1]));
    if (options_.base != BaseKind::fixed)
      out_.left_out.push_back(
          "what carries the base: neither thrust nor a contact with the ground is read, so that only "
          "the joints' own motors move it; `tiller models` lists robots that fly and drive");
    if (!robot_.free_joint.empty() && options_.base == BaseKind::fixed)
      out_.notes.push_back(robot_.path + ": joint '" + robot_.free_joint +
                           "' is free and held where the file puts it; --base free lets it move");
  }

  /// Points of interest, known by their names alone; a link goes before one of the same name.
  void add_points() {
    for (const FrameText& point : robot_.frames) {
      const int link = out_.find_frame(point.link);
      if (link < 0 || out_.find_frame(point.name) >= 0) continue;
      const NamedFrame& on = out_.frames[static_cast<std::size_t>(link)];
      out_.frames.push_back({point.name, on.body, on.pose * point.pose, false});
    }
  }

  void resolve_mimics() {
    std::map<std::string, int> index;
    for (std::size_t i = 0; i < raw_.size(); ++i) index[raw_[i].body.joint] = static_cast<int>(i);
    std::map<std::string, const JointText*> text;
    for (const JointText& joint : robot_.joints) text[joint.name] = &joint;
    for (RawBody& raw : raw_) {
      const auto found = text.find(raw.body.joint);
      if (found == text.end() || found->second->mimics.empty()) continue;
      // through a chain of mimics to a joint that moves by itself
      double ratio = 1.0, offset = 0.0;
      const JointText* joint = found->second;
      for (std::size_t steps = 0; joint != nullptr && !joint->mimics.empty() && steps <= text.size(); ++steps) {
        offset += ratio * joint->mimic_offset;
        ratio *= joint->mimic_ratio;
        joint = text.count(joint->mimics) > 0 ? text[joint->mimics] : nullptr;
      }
      if (joint == nullptr || !joint->mimics.empty()) {
        error(found->second->line, "joint '" + raw.body.joint + "' mimics itself");
        continue;
      }
      const auto leader = index.find(joint->name);
      if (leader == index.end()) {
        error(found->second->line, "joint '" + raw.body.joint + "' mimics '" + joint->name +
                                       "', which does not move; hold it too: --hold " + raw.body.joint);
        continue;
      }
      raw.body.mimics = leader->second;
      raw.body.mimic_ratio = ratio;
      raw.body.mimic_offset = offset;
      raw.body.actuated = false;
      give_to_leader(raw.body, raw_[static_cast<std::size_t>(leader->second)].body);
    }
  }

  /// What acts at a joint that follows acts at the one that it follows, through the ratio.
  static void give_to_leader(MovingBody& follower, MovingBody& leader) {
    const double r = follower.mimic_ratio, square = r * r;
    leader.damping += square * follower.damping;
    leader.friction += std::fabs(r) * follower.friction;
    if (follower.stiffness > 0.0 && r != 0.0) {
      const double about = (follower.rest - follower.mimic_offset) / r, more = square * follower.stiffness;
      leader.rest = (leader.stiffness * leader.rest + more * about) / (leader.stiffness + more);
      leader.stiffness += more;
      leader.wraps = false;
    }
    follower.damping = follower.friction = follower.stiffness = 0.0;
  }

  /// Every body's own frame, and from there what the equations need.
  void place_frames() {
    for (std::size_t i = 0; i < raw_.size(); ++i) {
      const RawBody* next = nullptr;
      for (const RawBody& other : raw_)
        if (next == nullptr && other.body.parent == static_cast<int>(i)) next = &other;
      if (next == nullptr) {
        raw_[i].aligned = align(raw_[i].axis, nullptr, nullptr);
        continue;
      }
      const Vec3<double> z = next->origin.rotation * next->axis;
      raw_[i].aligned = align(raw_[i].axis, &z, &next->origin.position);
    }
    for (const RawBody& raw : raw_) {
      const Pose above =
          raw.body.parent < 0 ? Pose{} : inverse(raw_[static_cast<std::size_t>(raw.body.parent)].aligned);
      MovingBody body = raw.body;
      body.frame = decompose(above * raw.origin * raw.aligned);
      for (LinkShare& share : body.links) share.body = moved(share.body, inverse(raw.aligned));
      out_.bodies.push_back(body);
    }
    for (NamedFrame frame : frames_) {
      if (frame.body >= 0) frame.pose = inverse(raw_[static_cast<std::size_t>(frame.body)].aligned) * frame.pose;
      out_.frames.push_back(frame);
    }
  }

  /// Every joint moves something: the bodies behind it have mass, or inertia about its axis.
  void check_masses() {
    std::vector<RigidBody> whole(out_.bodies.size());
    for (std::size_t i = 0; i < out_.bodies.size(); ++i)
      for (const LinkShare& share : out_.bodies[i].links) whole[i] = together(whole[i], share.body);
    std::vector<bool> moves(out_.bodies.size(), false);
    for (std::size_t i = out_.bodies.size(); i-- > 0;) {
      const MovingBody& body = out_.bodies[i];
      const RigidBody& b = whole[i];
      const double about_axis = b.inertia_kgm2(2, 2) + b.mass_kg * (b.com_m[0] * b.com_m[0] + b.com_m[1] * b.com_m[1]);
      const bool own = (body.prismatic ? b.mass_kg : about_axis) + body.armature > 0.0;
      if (!own && !moves[i])
        error(body.line, "joint '" + body.joint + "' moves nothing that has " +
                             (body.prismatic ? "mass" : "inertia about its axis") + links_behind(i) +
                             "; add <inertial> to them, make the joint fixed, or hold it: --hold " + body.joint);
      // what has mass off the axis, or more than a line of it, moves the joints before it too
      const bool any = b.mass_kg > 0.0 || moves[i];
      if (body.parent >= 0 && any) moves[static_cast<std::size_t>(body.parent)] = true;
    }
    for (const auto& [link, numbers] : notes_of_shape_) {
      if (moving_link(link->name))
        error(link->line, "no body can have the inertia of link '" + link->name + "' (" + numbers +
                              "; the largest is above the sum of the others); correct it, or take it as it is with "
                              "--any-inertia");
    }
  }

  /// A joint that its own motor accelerates beyond anything real has a rotor that the description leaves out.
  void note_light_joints() {
    const std::vector<double> gain = mobility(out_, start_position(out_));
    for (std::size_t i = 0; i < out_.bodies.size(); ++i) {
      const MovingBody& b = out_.bodies[i];
      const double most = b.effort * gain[i];
      if (!b.actuated || !std::isfinite(b.effort) || most < (b.prismatic ? kFast_m_s2 : kFast_rad_s2)) continue;
      out_.notes.push_back(at_line(b.line) + ": joint '" + b.joint +
                           format("' reaches %.0f %s by its own effort: the rotor's inertia is missing; ", most,
                                  b.prismatic ? "m/s2" : "rad/s2") +
                           "give it an armature in the file, or import with --armature " + b.joint + "=KGM2");
    }
  }

  bool moving_link(const std::string& name) const {
    for (const MovingBody& body : out_.bodies)
      for (const LinkShare& share : body.links)
        if (share.link == name) return true;
    return false;
  }

  std::string links_behind(std::size_t body) const {
    Words names;
    for (const NamedFrame& frame : out_.frames)
      if (frame.body == static_cast<int>(body)) names.push_back("'" + frame.name + "'");
    return names.empty() ? "" : (names.size() > 1 ? ": links " : ": link ") + join(names) + line_of(first_link(body));
  }
  std::string line_of(const std::string& link) const {
    const int line = link_.at(link)->line;
    return line > 0 ? " at line " + std::to_string(line) : "";
  }
  std::string first_link(std::size_t body) const {
    for (const NamedFrame& frame : out_.frames)
      if (frame.body == static_cast<int>(body)) return frame.name;
    return "";
  }

  const Description& robot_;
  const MechanismOptions& options_;
  Mechanism& out_;
  std::vector<std::string>& errors_;
  std::map<std::string, const LinkText*> link_;
  std::map<std::string, std::vector<const JointText*>> below_;
  std::map<std::string, double> held_;
  std::set<std::string> reached_;
  std::vector<NamedFrame> frames_;
  std::vector<RawBody> raw_;
  int laws_ = 0;  // of drives, taken
  std::vector<std::pair<const LinkText*, std::string>> notes_of_shape_;
};

bool matches(const std::string& pattern, const std::string& name) {
  return ::fnmatch(pattern.c_str(), name.c_str(), 0) == 0;
}

}  // namespace

std::vector<double> start_position(const Mechanism& mechanism) {
  std::vector<double> out;
  for (const MovingBody& b : mechanism.bodies) {
    const bool ranged = std::isfinite(b.high - b.low);
    const double margin = ranged ? 0.1 * (b.high - b.low) : 0.0;
    if (std::isfinite(b.start))
      out.push_back(std::min(std::max(b.start, b.low), b.high));
    else if (b.low + margin <= 0.0 && 0.0 <= b.high - margin)
      out.push_back(0.0);
    else
      out.push_back(ranged ? 0.5 * (b.low + b.high) : std::isfinite(b.low) ? b.low : b.high);
  }
  for (std::size_t i = 0; i < out.size(); ++i)
    if (const MovingBody& b = mechanism.bodies[i]; b.mimics >= 0)
      out[i] = b.mimic_ratio * out[static_cast<std::size_t>(b.mimics)] + b.mimic_offset;
  return out;
}

std::vector<BodyInertia<double>> body_inertias(const Mechanism& mechanism) {
  std::vector<BodyInertia<double>> inertia;
  for (const MovingBody& body : mechanism.bodies) {
    RigidBody whole;
    for (const LinkShare& share : body.links) whole = together(whole, share.body);
    BodyInertia<double> b;
    b.mass = whole.mass_kg;
    b.moment = scaled(whole.mass_kg, whole.com_m);
    const Mat3<double> arm = skew(whole.com_m);
    const Mat3<double> square = arm * arm;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) b.inertia(r, c) = whole.inertia_kgm2(r, c) - whole.mass_kg * square(r, c);
    inertia.push_back(b);
  }
  return inertia;
}

std::vector<double> mobility(const Mechanism& mechanism, const std::vector<double>& position) {
  ArticulatedBody<double> tree(mechanism, body_inertias(mechanism));
  tree.place(position);
  tree.weigh();
  std::vector<double> out;
  for (std::size_t j = 0; j < mechanism.bodies.size(); ++j) out.push_back(tree.respond(j)[j]);
  return out;
}

bool expand_held(const Description& robot, MechanismOptions& options, std::vector<std::string>& errors) {
  std::vector<MechanismOptions::Held> all;
  for (const MechanismOptions::Held& held : options.held) {
    const std::size_t before = all.size();
    if (held.joint.find_first_of("*?[") == std::string::npos)
      all.push_back(held);
    else
      for (const JointText& joint : robot.joints)
        if (joint.kind != JointKind::fixed && matches(held.joint, joint.name))
          all.push_back({joint.name, held.position});
    if (all.size() > before) continue;
    Words names;
    for (const JointText& joint : robot.joints)
      if (joint.kind != JointKind::fixed) names.push_back(joint.name);
    errors.push_back("--hold " + held.joint + ": " + robot.path + " has no such joints; there are " + join(names));
  }
  options.held = all;
  return errors.empty();
}

std::string pattern_of(const std::vector<std::string>& names, std::size_t count) {
  std::string best;
  std::size_t fewest = names.size();
  const auto consider = [&](const std::string& pattern) {
    const auto found = static_cast<std::size_t>(
        std::count_if(names.begin(), names.end(), [&](const std::string& name) { return matches(pattern, name); }));
    if (found < count || found >= fewest || found < 2) return;
    fewest = found;
    best = pattern;
  };
  // the same joint of every leg before all joints of one leg, which would lame it
  for (const bool ends : {true, false})
    for (const std::string& name : names)
      for (std::size_t at = name.find('_'); at != std::string::npos && (ends || best.empty());
           at = name.find('_', at + 1))
        consider(ends ? "*" + name.substr(at) : name.substr(0, at + 1) + "*");
  return best.empty() ? best : "'" + best + "' (" + std::to_string(fewest) + " joints)";
}

bool build_mechanism(const Description& robot, const MechanismOptions& options, Mechanism& mechanism,
                     std::vector<std::string>& errors) {
  return Builder(robot, options, mechanism, errors).run();
}

}  // namespace tiller::tools
