#include <tinyxml2.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <set>

#include "tools/base/text.hpp"
#include "tools/description/description.hpp"

namespace tiller::tools {
namespace {

using tinyxml2::XMLElement;

/// A number that stands alone in a text; false: the text is something else.
bool read_number(const char*& at, double& value) {
  char* end = nullptr;
  value = std::strtod(at, &end);
  if (end == at || !std::isfinite(value)) return false;
  at = end;
  return true;
}

bool at_end(const char* at) { return at[std::strspn(at, " \t\r\n")] == '\0'; }

class Reader {
 public:
  Reader(Description& robot, std::vector<std::string>& errors) : robot_(robot), errors_(errors) {}

  void read(const XMLElement& root) {
    robot_.name = root.Attribute("name") != nullptr ? root.Attribute("name") : "robot";
    for (const XMLElement* e = root.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      const std::string tag = e->Name();
      if (tag == "link")
        read_link(*e);
      else if (tag == "joint")
        read_joint(*e);
      else if (tag.rfind("xacro:", 0) == 0)
        return refuse_xacro(*e);
      else if (tag == "transmission")
        left_out_.insert("transmission");
      else if (tag != "material" && tag != "gazebo" && tag != "sensor" && tag != "group" && tag != "ros2_control")
        note(*e, "<" + tag + "> is not read");
    }
    if (left_out_.count("transmission") > 0)
      robot_.notes.push_back(robot_.path +
                             ": <transmission> is not read: inputs are joint forces; name a gain with "
                             "--unknown gain:JOINT where a gear's ratio or a motor's constant is in doubt");
    check_names();
  }

  void refuse_xacro(const XMLElement& e) {
    error(e.GetLineNum(), std::string("<") + e.Name() + "> is xacro's, which has to be expanded first; run `xacro " +
                              robot_.path + " > robot.urdf` and import that");
  }

 private:
  void error(int line, const std::string& text) {
    errors_.push_back(robot_.path + ":" + std::to_string(line) + ": " + text);
  }
  void note(const XMLElement& e, const std::string& text) {
    robot_.notes.push_back(robot_.path + ":" + std::to_string(e.GetLineNum()) + ": " + text);
  }

  std::string name_of(const XMLElement& e) {
    const char* name = e.Attribute("name");
    if (name != nullptr && *name != '\0') return name;
    error(e.GetLineNum(), std::string("<") + e.Name() + "> has no name; add name=\"...\"");
    return "";
  }

  /// A number of an attribute; `value` stays where the attribute is missing.
  void number(const XMLElement* e, const char* key, double& value, bool required = false) {
    if (e == nullptr) return;
    const char* text = e->Attribute(key);
    if (text == nullptr) {
      if (required) error(e->GetLineNum(), std::string("<") + e->Name() + "> lacks " + key + "=\"...\"");
      return;
    }
    double read = 0.0;
    const char* at = text;
    if (read_number(at, read) && at_end(at))
      value = read;
    else
      error(e->GetLineNum(), std::string(key) + "=\"" + text + "\" is no finite number");
  }

  void triple(const XMLElement* e, const char* key, Vec3<double>& value) {
    const char* text = e != nullptr ? e->Attribute(key) : nullptr;
    if (text == nullptr) return;
    Vec3<double> read{};
    const char* at = text;
    if (read_number(at, read[0]) && read_number(at, read[1]) && read_number(at, read[2]) && at_end(at))
      value = read;
    else
      error(e->GetLineNum(), std::string(key) + "=\"" + text + "\" is not three finite numbers");
  }

  Pose origin(const XMLElement& e) {
    const XMLElement* at = e.FirstChildElement("origin");
    Vec3<double> rpy{}, xyz{};
    triple(at, "rpy", rpy);
    triple(at, "xyz", xyz);
    return {rotation_rpy(rpy), xyz};
  }

  void read_link(const XMLElement& e) {
    LinkText link;
    link.name = name_of(e);
    link.line = e.GetLineNum();
    if (const XMLElement* inertial = e.FirstChildElement("inertial")) read_inertia(*inertial, link);
    robot_.links.push_back(link);
  }

  void read_inertia(const XMLElement& e, LinkText& link) {
    const XMLElement* mass = e.FirstChildElement("mass");
    const XMLElement* inertia = e.FirstChildElement("inertia");
    link.line = e.GetLineNum();
    if (mass == nullptr || inertia == nullptr)
      return error(e.GetLineNum(), "<inertial> of link '" + link.name + "' lacks <" +
                                       (mass == nullptr ? "mass value=\"kg\"" : "inertia ixx=\"kgm2\" ...") + "/>");
    link.has_inertia = true;
    RigidBody body;
    number(mass, "value", body.mass_kg, true);
    const char* const keys[3][3] = {{"ixx", "ixy", "ixz"}, {"ixy", "iyy", "iyz"}, {"ixz", "iyz", "izz"}};
    for (int r = 0; r < 3; ++r)
      for (int c = r; c < 3; ++c) {
        number(inertia, keys[r][c], body.inertia_kgm2(r, c), r == c);
        body.inertia_kgm2(c, r) = body.inertia_kgm2(r, c);
      }
    link.body = moved(body, origin(e));
    if (body.mass_kg < 0.0) error(mass->GetLineNum(), "link '" + link.name + "' has a negative mass");
  }

  bool kind_of(const XMLElement& e, JointKind& kind) {
    static const std::pair<const char*, JointKind> kinds[] = {
        {"fixed", JointKind::fixed},         {"revolute", JointKind::revolute}, {"continuous", JointKind::continuous},
        {"prismatic", JointKind::prismatic}, {"floating", JointKind::floating}, {"planar", JointKind::planar}};
    const char* type = e.Attribute("type");
    for (const auto& [name, known] : kinds)
      if (type != nullptr && std::strcmp(type, name) == 0) {
        kind = known;
        return true;
      }
    error(e.GetLineNum(), std::string("type=\"") + (type != nullptr ? type : "") +
                              "\" of a joint is none of fixed, revolute, continuous, prismatic, floating, planar");
    return false;
  }

  std::string link_of(const XMLElement& e, const char* tag) {
    const XMLElement* at = e.FirstChildElement(tag);
    const char* link = at != nullptr ? at->Attribute("link") : nullptr;
    if (link != nullptr) return link;
    error(e.GetLineNum(), std::string("<joint> lacks <") + tag + " link=\"...\"/>");
    return "";
  }

  void read_joint(const XMLElement& e) {
    JointText joint;
    joint.name = name_of(e);
    joint.line = e.GetLineNum();
    if (!kind_of(e, joint.kind)) return;
    joint.parent = link_of(e, "parent");
    joint.child = link_of(e, "child");
    joint.origin = origin(e);
    if (joint.kind == JointKind::fixed) return void(robot_.joints.push_back(joint));
    const XMLElement* axis = e.FirstChildElement("axis");
    triple(axis, "xyz", joint.axis);
    const double length = std::sqrt(dot(joint.axis, joint.axis));
    if (length > 1e-6)
      joint.axis = scaled(1.0 / length, joint.axis);
    else
      error(axis->GetLineNum(), "the axis of joint '" + joint.name + "' has no length");
    read_limits(e, joint);
    const XMLElement* dynamics = e.FirstChildElement("dynamics");
    number(dynamics, "damping", joint.damping);
    number(dynamics, "friction", joint.friction);
    number(dynamics, "armature", joint.armature);
    if (joint.damping < 0.0 || joint.friction < 0.0 || joint.armature < 0.0)
      error(dynamics->GetLineNum(), "<dynamics> of joint '" + joint.name + "' has a negative value");
    if (const XMLElement* mimic = e.FirstChildElement("mimic")) {
      const char* followed = mimic->Attribute("joint");
      if (followed == nullptr) error(mimic->GetLineNum(), "<mimic> lacks joint=\"...\"");
      joint.mimics = followed != nullptr ? followed : "";
      number(mimic, "multiplier", joint.mimic_ratio);
      number(mimic, "offset", joint.mimic_offset);
    }
    robot_.joints.push_back(joint);
  }

  void read_limits(const XMLElement& e, JointText& joint) {
    const XMLElement* limit = e.FirstChildElement("limit");
    if (limit == nullptr) return;
    joint.has_limits = true;
    if (joint.kind == JointKind::revolute || joint.kind == JointKind::prismatic) {
      joint.low = joint.high = 0.0;  // URDF's own defaults
      number(limit, "lower", joint.low);
      number(limit, "upper", joint.high);
      if (joint.low == joint.high) {
        joint.low = -std::numeric_limits<double>::infinity();
        joint.high = -joint.low;
        note(*limit, "joint '" + joint.name + "' has lower = upper: taken for no limits");
      } else if (joint.low > joint.high) {
        error(limit->GetLineNum(), "joint '" + joint.name + "' has lower above upper");
      }
    }
    number(limit, "effort", joint.effort);
    number(limit, "velocity", joint.speed);
    if (!(joint.effort > 0.0)) joint.effort = std::numeric_limits<double>::infinity();
    if (!(joint.speed > 0.0)) joint.speed = std::numeric_limits<double>::infinity();
    const bool ended = std::isfinite(joint.low) || std::isfinite(joint.high);
    joint.open_ends();
    if (joint.kind == JointKind::revolute && ended && !std::isfinite(joint.low) && !std::isfinite(joint.high))
      joint.kind = JointKind::continuous;  // a propeller, said by 1e16
  }

  void check_names() {
    std::set<std::string> links, joints;
    for (const LinkText& link : robot_.links)
      if (!links.insert(link.name).second) error(link.line, "a second link '" + link.name + "'");
    for (const JointText& joint : robot_.joints) {
      if (!joints.insert(joint.name).second) error(joint.line, "a second joint '" + joint.name + "'");
      for (const std::string& end : {joint.parent, joint.child})
        if (!end.empty() && links.count(end) == 0)
          error(joint.line,
                "joint '" + joint.name + "' names link '" + end + "', which there is not" + meant(end, links));
    }
    for (const JointText& joint : robot_.joints)
      if (!joint.mimics.empty() && joints.count(joint.mimics) == 0)
        error(joint.line, "joint '" + joint.name + "' mimics '" + joint.mimics + "', which there is not");
  }

  static std::string meant(const std::string& word, const std::set<std::string>& known) {
    const std::string near = nearest(word, {known.begin(), known.end()});
    return near.empty() ? "" : "; is '" + near + "' meant?";
  }

  Description& robot_;
  std::vector<std::string>& errors_;
  std::set<std::string> left_out_;
};

}  // namespace

bool read_urdf(const std::string& path, Description& robot, std::vector<std::string>& errors) {
  robot = {};
  robot.path = path;
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file.good() && !file.eof()) {
    errors.push_back(path + ": cannot be read: " + std::strerror(errno));
    return false;
  }
  if (text.empty()) {
    errors.push_back(path + ": is empty or cannot be read");
    return false;
  }
  tinyxml2::XMLDocument document;
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
    errors.push_back(path + ":" + std::to_string(document.ErrorLineNum()) +
                     ": no XML: " + (document.ErrorStr() != nullptr ? document.ErrorStr() : "") +
                     "; a URDF is the XML that `xacro` writes or `ros2 param get` shows as robot_description");
    return false;
  }
  const XMLElement* root = document.RootElement();
  if (root == nullptr || std::strcmp(root->Name(), "robot") != 0) {
    const std::string name = root != nullptr ? root->Name() : "";
    errors.push_back(path + ":" + std::to_string(root != nullptr ? root->GetLineNum() : 1) + ": the root is <" + name +
                     ">, a URDF's is <robot>" +
                     (name == "mujoco"          ? "; this is an MJCF"
                      : name == "mujocoinclude" ? "; this is a part of an MJCF: import the file that includes it"
                      : name == "sdf"           ? "; this is an SDF, which is not read"
                                                : ""));
    return false;
  }
  Reader reader(robot, errors);
  reader.read(*root);
  if (errors.empty() && robot.links.empty()) errors.push_back(path + ": has no <link>");
  return errors.empty();
}

}  // namespace tiller::tools
