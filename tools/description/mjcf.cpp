#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/description/description.hpp"
#include "tools/description/mjcf_drives.hpp"
#include "tools/description/mjcf_sensors.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::json;

Vec3<double> triple(const Json& json) { return json.get<std::array<double, 3>>(); }
Pose pose_of(const Json& quaternion, const Json& position) {
  return {rotation_of_quaternion(quaternion.get<std::array<double, 4>>()), triple(position)};
}
std::string text(const Json& json, const char* key) { return json.at(key).get<std::string>(); }
double number(const Json& json, const char* key) { return json.at(key).get<double>(); }

/// A joint moves its body in the axes that the joints before it leave: each becomes a link of its own, whose origin is
/// the joint's anchor. MuJoCo's positions stay as they are, so a joint may stand at another one than 0 in the file.
class CompiledReader {
 public:
  CompiledReader(const Json& json, Description& robot, std::vector<std::string>& errors)
      : json_(json), bodies_(json.at("bodies")), robot_(robot), errors_(errors) {}

  void read() {
    robot_.name = text(json_, "name");
    robot_.gravity_m_s2 = triple(json_.at("gravity"));
    for (std::size_t b = 0; b < bodies_.size(); ++b)
      if (!reaches_world(b))
        return error("body '" + body_name(b) +
                     "' hangs on itself, which MuJoCo does not write; import the MJCF itself");
    find_trees();
    if (!errors_.empty()) return;
    for (std::size_t b = 0; b < bodies_.size(); ++b)
      if (!left_out(b)) add_body(b);
    read_equalities();
    std::set<std::string> joints_of_props;
    for (const Json& joint : json_.at("joints"))
      if (left_out(joint.at("body").get<std::size_t>())) joints_of_props.insert(text(joint, "name"));
    DriveReader(json_, joints_of_props, robot_).read();
    for (const Json& site : json_.at("sites"))
      if (const std::size_t b = site.at("body").get<std::size_t>(); !left_out(b))
        robot_.frames.push_back({text(site, "name"), body_name(b), pose_of(site.at("quat"), site.at("pos"))});
    read_sensors(json_, robot_);
    read_home();
    read_shapes();
    note_the_rest();
  }

 private:
  void error(const std::string& what) { errors_.push_back(robot_.path + ": " + what); }
  void note(const std::string& what) { robot_.notes.push_back(robot_.path + ": " + what); }
  void leave_out(const std::string& what) { robot_.left_out.push_back(what); }
  static std::string listed(const std::string& what, const Words& names) {
    return what + (names.size() > 1 ? "s " : " ") + join(names) + ": ";
  }
  /// A note about all that are named in a list.
  void note_of(const std::string& what, const Words& names, const std::string& says) {
    if (!names.empty()) note(listed(what, names) + says);
  }
  void leave_out_of(const std::string& what, const Words& names, const std::string& says) {
    if (!names.empty()) leave_out(listed(what, names) + says);
  }

  std::string body_name(std::size_t b) const { return text(bodies_.at(b), "name"); }
  std::size_t parent(std::size_t b) const { return bodies_.at(b).at("parent").get<std::size_t>(); }
  bool reaches_world(std::size_t b) const {
    for (std::size_t steps = 0; b != 0 && steps < bodies_.size(); ++steps) b = parent(b);
    return b == 0;
  }
  /// The child of the world that carries a body.
  std::size_t tree_of(std::size_t b) const {
    while (b != 0 && parent(b) != 0) b = parent(b);
    return b;
  }
  bool left_out(std::size_t b) const { return props_.count(tree_of(b)) > 0; }

  /// What floats: the robot itself, or things that lie about in its scene.
  void find_trees() {
    std::map<std::size_t, std::string> floats;  // by tree, its free joint
    std::map<std::size_t, std::string> moves;   // by tree, one of its other joints
    for (const Json& joint : json_.at("joints")) {
      const auto tree = tree_of(joint.at("body").get<std::size_t>());
      (text(joint, "type") == "free" ? floats : moves)[tree] = text(joint, "name");
    }
    std::vector<std::size_t> robots;
    for (const auto& [tree, joint] : floats)
      if (moves.count(tree) > 0) robots.push_back(tree);
    const bool one_stands = moves.size() > robots.size();
    if (robots.empty() && !one_stands)
      for (const auto& [tree, joint] : floats) robots.push_back(tree);
    if (robots.size() + (one_stands ? 1 : 0) > 1) {
      Words names;
      for (const std::size_t tree : robots) names.push_back("'" + body_name(tree) + "'");
      return error((names.size() > 1 ? "bodies " : "body ") + join(names) + (names.size() > 1 ? " float" : " floats") +
                   (one_stands ? " beside a robot that stands on the world" : "") +
                   "; an import is one robot: take the others out of the file");
    }
    if (!robots.empty()) base_ = robots[0];
    Words names;
    for (const auto& [tree, joint] : floats)
      if (tree != base_) {
        props_.insert(tree);
        names.push_back(body_name(tree));
      }
    note_of("free thing", names, "not part of the robot, left out");
  }

  void add_body(std::size_t b) {
    const Json& body = bodies_[b];
    LinkText link;
    link.name = body_name(b);
    const Vec3<double> moment = triple(body.at("inertia"));
    const Pose principal = pose_of(body.at("iquat"), body.at("ipos"));
    RigidBody inertia;
    inertia.mass_kg = number(body, "mass");
    for (int k = 0; k < 3; ++k) inertia.inertia_kgm2(k, k) = moment[static_cast<std::size_t>(k)];
    link.body = moved(inertia, principal);
    // furniture does not travel with a robot that floats
    const bool furniture = base_ != 0 && body.at("on_world").get<bool>();
    link.has_inertia = !furniture && (inertia.mass_kg > 0.0 || dot(moment, moment) > 0.0);
    robot_.links.push_back(link);
    if (b == 0) return;

    std::string above = body_name(parent(b));
    Pose at = pose_of(body.at("quat"), body.at("pos"));  // of the body's frame in the link that it hangs on so far
    std::vector<const Json*> joints;
    for (const Json& joint : json_.at("joints"))
      if (joint.at("body").get<std::size_t>() == b) joints.push_back(&joint);
    for (const Json* joint : joints) {
      if (text(*joint, "type") == "free") {
        robot_.free_joint = text(*joint, "name");
        continue;
      }
      const Vec3<double> anchor = text(*joint, "type") == "slide" ? Vec3<double>{} : triple(joint->at("pos"));
      const bool ends = joint == joints.back() && dot(anchor, anchor) == 0.0;
      const std::string below = ends ? link.name : link.name + ":" + text(*joint, "name");
      add_joint(*joint, at * Pose{Mat3<double>::identity(), anchor}, above, below);
      at = {Mat3<double>::identity(), scaled(-1.0, anchor)};
      if (ends) return;
      above = below;
      LinkText between;
      between.name = below;
      robot_.links.push_back(between);
    }
    JointText weld;
    weld.name =
        joints.size() == 1 && !robot_.free_joint.empty() && b == base_ ? robot_.free_joint : link.name + ":fixed";
    weld.parent = above;
    weld.child = link.name;
    weld.origin = at;
    robot_.joints.push_back(weld);
  }

  void add_joint(const Json& json, const Pose& at, const std::string& above, const std::string& below) {
    JointText joint;
    joint.name = text(json, "name");
    joint.parent = above;
    joint.child = below;
    joint.origin = at;
    joint.axis = triple(json.at("axis"));
    const std::string type = text(json, "type");
    const double initial = number(json, "ref");
    joint.stiffness = number(json, "stiffness");
    joint.rest = number(json, "springref");
    joint.has_limits = json.at("limited").get<bool>();
    if (type == "ball") {
      joint.kind = JointKind::ball;
    } else if (type == "slide") {
      joint.kind = JointKind::prismatic;
      joint.origin.position = at.position - scaled(initial, at.rotation * joint.axis);
    } else {
      // a spring remembers the turns
      joint.kind = joint.has_limits || joint.stiffness > 0.0 ? JointKind::revolute : JointKind::continuous;
      if (initial != 0.0) joint.origin.rotation = at.rotation * rotation_about(joint.axis, -initial);
    }
    if (joint.has_limits) {
      joint.low = json.at("range").at(0).get<double>();
      joint.high = json.at("range").at(1).get<double>();
      joint.open_ends();
    }
    joint.damping = number(json, "damping");
    joint.friction = number(json, "frictionloss");
    joint.armature = number(json, "armature");
    joint.actuated = false;
    for (const Json& what : json.at("beyond"))
      leave_out("joint '" + joint.name + "' has " + what.get<std::string>() + ": not read");
    robot_.joints.push_back(joint);
  }

  JointText* find_joint(const std::string& name) {
    for (JointText& joint : robot_.joints)
      if (joint.name == name && joint.kind != JointKind::fixed) return &joint;
    return nullptr;
  }

  void read_equalities() {
    std::map<std::string, double> initial;
    for (const Json& joint : json_.at("joints")) initial[text(joint, "name")] = number(joint, "ref");
    for (const Json& e : json_.at("equalities")) {
      const std::string name = text(e, "name"), type = text(e, "type");
      if (!e.at("active").get<bool>()) {
        note("equality '" + name + "' is switched off: not read");
      } else if (type == "joint") {
        couple(e, name, initial);
      } else if (type == "connect" || type == "weld") {
        const auto ends = e.at("bodies").get<std::array<std::string, 2>>();
        robot_.ties.push_back({name, type, ends[0], ends[1]});
      } else {
        leave_out("equality '" + name + "' (" + type + ") is not read");
      }
    }
  }

  /// q - q0 = a0 + a1 (p - p0) + ..., of the first joint by the second.
  void couple(const Json& e, const std::string& name, std::map<std::string, double>& initial) {
    const auto own = e.at("joints").at(0).get<std::string>();
    const auto c = e.at("data").get<std::array<double, 5>>();
    JointText* joint = find_joint(own);
    if (joint == nullptr)
      return leave_out("equality '" + name + "' couples '" + own + "', which is no hinge or slide: not read");
    const bool alone = e.at("joints").size() < 2;
    if (alone || c[2] != 0.0 || c[3] != 0.0 || c[4] != 0.0)
      return error(
          "equality '" + name + "' holds joint '" + own + "' " +
          (alone ? "at " + number_text(initial[own] + c[0]) + "; take it out and import with --hold " + own + "=" +
                       number_text(initial[own] + c[0])
                 : "to a curve of another's position; only straight lines are read: take it out, or leave it two "
                   "coefficients"));
    if (!joint->mimics.empty())
      return error("equality '" + name + "' couples joint '" + own + "', which follows '" + joint->mimics +
                   "' already; take one of the two out");
    joint->mimics = e.at("joints").at(1).get<std::string>();
    joint->mimic_ratio = c[1];
    joint->mimic_offset = initial[own] + c[0] - c[1] * initial[joint->mimics];
  }

  void read_home() {
    const Json& joints = json_.at("joints");
    for (const Json& key : json_.at("keyframes")) {
      if (text(key, "name") != "home") continue;
      for (std::size_t j = 0; j < joints.size(); ++j)
        if (JointText* joint = find_joint(text(joints[j], "name")); joint != nullptr)
          joint->start = key.at("positions").at(j).get<double>();
    }
  }

  static TouchLaw law_of(const Json& json) {
    TouchLaw law;
    law.friction = number(json, "friction");
    const double first = json.at("solref").at(0).get<double>(), second = json.at("solref").at(1).get<double>();
    const bool is_direct = first <= 0.0;  // -stiffness, -damping, per mass
    law.settle_s = is_direct ? (second < 0.0 ? -2.0 / second : std::numeric_limits<double>::infinity()) : first;
    law.damping_ratio = is_direct ? (first < 0.0 ? -0.5 * second / std::sqrt(-first) : 0.0) : second;
    law.impedance = std::clamp(json.at("solimp").at(1).get<double>(), 0.0001, 0.9999);
    return law;
  }

  void read_shapes() {
    robot_.has_shapes = json_.contains("shapes");
    if (!robot_.has_shapes) return;  // an older import's
    for (const Json& json : json_.at("shapes")) {
      ShapeText shape;
      shape.name = text(json, "name");
      shape.link = text(json, "body");
      shape.type = text(json, "type");
      shape.pose = pose_of(json.at("quat"), json.at("pos"));
      shape.size = triple(json.at("size"));
      shape.law = law_of(json);
      shape.condim = json.at("condim").get<int>();
      shape.priority = json.at("priority").get<int>();
      shape.mix = number(json, "solmix");
      robot_.shapes.push_back(shape);
    }
    for (const Json& json : json_.at("pairs")) {
      const auto ends = json.at("geoms").get<std::array<std::string, 2>>();
      robot_.pairs.push_back({ends[0], ends[1], law_of(json), json.at("condim").get<int>()});
      if (robot_.pairs.back().condim == 1) robot_.pairs.back().law.friction = 0.0;
    }
    robot_.grip_ratio = number(json_, "impratio");
  }

  void note_the_rest() {
    Words light;
    for (std::size_t b = 0; b < bodies_.size(); ++b)
      if (number(bodies_[b], "gravcomp") != 0.0 && !left_out(b)) light.push_back(body_name(b));
    leave_out_of("link", light, "gravcomp is not read: the joints carry the whole weight");
    if (number(json_, "density") > 0.0 || number(json_, "viscosity") > 0.0 || !json_.at("fluid_bodies").empty())
      leave_out("the medium's density and viscosity are not read");
    leave_out_of("plugin", json_.at("plugins").get<Words>(), "not read");
    leave_out_of("soft part", json_.at("flexes").get<Words>(), "not read: bodies are rigid");
    leave_out_contacts();
  }

  void leave_out_contacts() {
    const int count = json_.at("touching").get<int>();
    if (count == 0) return;
    // of a JSON that an older import has kept, nobody knows
    Words bodies = json_.value("touching_world", Words{});
    constexpr std::size_t kTold = 4;
    const std::size_t more = bodies.size() > kTold ? bodies.size() - kTold : 0;
    bodies.resize(bodies.size() - more);
    const std::string on_world = bodies.empty() ? ""
                                                : ", those of " + join(bodies) +
                                                      (more > 0 ? " and " + std::to_string(more) + " more" : "") +
                                                      " also what stands on the world";
    leave_out(
        "CONTACTS are not read: " + std::to_string(count) + " shapes may touch something" + on_world +
        "; in the model links pass through each other and the ground, feet push on nothing and grippers hold nothing");
  }

  const Json& json_;
  const Json& bodies_;
  Description& robot_;
  std::vector<std::string>& errors_;
  std::size_t base_ = 0;         ///< the body that floats with the robot; 0: it stands on the world
  std::set<std::size_t> props_;  ///< trees that float beside it
};

std::string file_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

bool read_compiled_mjcf(const std::string& json, const std::string& path, Description& robot,
                        std::vector<std::string>& errors) {
  robot = {};
  robot.path = path;
  robot.compiled = json;
  const std::size_t before = errors.size();
  try {
    const Json parsed = Json::parse(json);
    if (parsed.contains("error"))
      errors.push_back(path + ": " + parsed["error"].get<std::string>());
    else
      CompiledReader(parsed, robot, errors).read();
  } catch (const Json::exception& e) {
    errors.push_back(path + ": what tiller_tools.mjcf says of it cannot be read: " + e.what());
  }
  return errors.size() == before;
}

bool read_mjcf(const std::string& path, Description& robot, std::vector<std::string>& errors) {
  std::error_code code;
  std::string folder = (std::filesystem::temp_directory_path(code) / "tiller-mjcf-XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) {
    errors.push_back(folder + ": no folder for temporary files; set TMPDIR to one that can be written");
    return false;
  }
  const std::string out = folder + "/compiled.json";
  std::string error;
  const bool ran = run_python_tool("mjcf", {path, out}, error);
  const std::string json = ran ? file_text(out) : "";
  std::filesystem::remove_all(folder, code);
  if (ran) return read_compiled_mjcf(json, path, robot, errors);
  errors.push_back(path + ": " + error);
  return false;
}

}  // namespace tiller::tools
