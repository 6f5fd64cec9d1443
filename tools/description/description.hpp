#pragma once

#include <limits>
#include <string>
#include <vector>

#include "tools/description/linear.hpp"

namespace tiller::tools {

/// What a robot description says, as it says it: links and joints by name, nothing derived, each with its line for
/// messages. Readers of other formats fill the same.
struct LinkText {
  std::string name;
  int line = 0;  ///< 0: the format keeps none
  bool has_inertia = false;
  RigidBody body;  ///< in the link's frame
};

enum class JointKind { fixed, revolute, continuous, prismatic, floating, planar, ball };

/// What a drive makes of its command, as a force at its joint: stiffness (goal - q) - damping v, within the limit;
/// without stiffness command + goal_at_zero - damping v, of a command that is a force.
struct DriveLaw {
  std::string kind;  ///< "position servo lifter"; empty: the command is the joint's force
  double stiffness = 0.0, damping = 0.0;
  double limit = std::numeric_limits<double>::infinity();  ///< of the force
  double low = -std::numeric_limits<double>::infinity(),
         high = std::numeric_limits<double>::infinity();  ///< of the goal
  double goal_per_control = 1.0,
         goal_at_zero = 0.0;  ///< goal = goal_at_zero + goal_per_control ctrl, of the file's ctrl
  bool is_stable = true;      ///< neither stiffness nor damping is negative
};

struct JointText {
  std::string name;
  int line = 0;
  JointKind kind = JointKind::fixed;
  std::string parent, child;
  Pose origin;                       ///< of the child's frame in the parent's, where the joint stands at 0
  Vec3<double> axis{1.0, 0.0, 0.0};  ///< unit, in the child's frame
  bool has_limits = false;
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
  double effort = std::numeric_limits<double>::infinity();  ///< Nm or N
  double speed = std::numeric_limits<double>::infinity();   ///< rad/s or m/s
  double damping = 0.0;                                     ///< Nms or Ns/m
  double friction = 0.0;                                    ///< Nm or N
  double armature = 0.0;                                    ///< kgm2 or kg
  double stiffness = 0.0, rest = 0.0;                       ///< a spring about `rest`: Nm/rad or N/m; rad or m
  double start = std::numeric_limits<double>::quiet_NaN();  ///< where it stands at first; NaN: nobody says
  bool actuated = true;
  DriveLaw law;
  std::vector<std::string> law_told;  ///< for whoever leaves the law out, a sentence for each drive that has one
  std::string mimics;                 ///< the joint that this one follows; empty: none
  double mimic_ratio = 1.0, mimic_offset = 0.0;

  /// One more spring: two about different positions are one about a third.
  void add_spring(double more, double about) {
    rest = (stiffness * rest + more * about) / (stiffness + more);
    stiffness += more;
    if (kind == JointKind::continuous) kind = JointKind::revolute;  // a spring remembers the turns
  }
  /// Takes what is as large as 1e16, which descriptions write where a joint has no end, for none.
  void open_ends() {
    constexpr double kNoEnd = 1e6, kNone = std::numeric_limits<double>::infinity();
    if (low <= -kNoEnd) low = -kNone;
    for (double* most : {&high, &effort, &speed})
      if (*most >= kNoEnd) *most = kNone;
  }
};

/// A point of interest on a link.
struct FrameText {
  std::string name, link;
  Pose pose;  ///< in the link's frame
};

/// How two shapes push at each other: MuJoCo's terms, as it mixes them for a pair.
struct TouchLaw {
  double friction = 0.0;       ///< 0: none
  double settle_s = 0.02;      ///< solref's time constant
  double damping_ratio = 1.0;  ///< solref's
  double impedance = 0.95;     ///< solimp's, where the shapes are in each other
};

/// A shape on a link: what may touch.
struct ShapeText {
  std::string name, link, type;  ///< type as in an MJCF: "sphere"
  Pose pose;                     ///< in the link's frame
  Vec3<double> size{};           ///< MuJoCo's: radius; radius and half length; half edges
  TouchLaw law;
  int condim = 3, priority = 0;
  double mix = 1.0;  ///< weight where a pair's law is mixed
};
/// A pair whose law stands in the file.
struct PairText {
  std::string a, b;
  TouchLaw law;
  int condim = 3;
};

/// What ties two links beside the joints of the tree.
struct TieText {
  std::string name, kind, link_a, link_b;
};

/// A sensor as the file has it, of a joint or of a point of a link.
struct SensorText {
  std::string name, kind;  ///< MuJoCo's word: "gyro"
  std::string joint;       ///< of jointpos and jointvel; else empty
  FrameText at;            ///< the site or the link that carries it
  bool on_link = false;    ///< `at` is a link
  double sd = 0.0;         ///< of its noise; 0: nobody says
};

struct Description {
  std::string path, name;
  std::vector<LinkText> links;
  std::vector<JointText> joints;
  std::vector<FrameText> frames;
  std::vector<TieText> ties;
  std::vector<ShapeText> shapes;
  std::vector<PairText> pairs;
  bool has_shapes = false;  ///< the format has them, and an import that wrote them
  double grip_ratio = 1.0;  ///< MuJoCo's impratio: how much stiffer friction is than the push
  std::vector<SensorText> sensors;
  std::string free_joint;  ///< what carries the whole robot through space, where the file has such a joint: fixed here
  Vec3<double> gravity_m_s2{0.0, 0.0, -9.81};
  std::string compiled;               ///< of an MJCF: what MuJoCo says of it, as JSON, which can be read in its place
  std::vector<std::string> notes;     ///< "file:line: what was read otherwise than it stands there, and why"
  std::vector<std::string> left_out;  ///< what acts on the robot and on no model of it, a sentence each
  std::vector<std::string> idle_drives;  ///< "name (tendon t)" of actuators that drive no joint of the model
};

/// Reads a description, by what the file holds and not by its name: a URDF (<robot>), an MJCF (<mujoco>), an .mjb, or
/// the JSON that is made of the two. False with every problem in `errors`, "file:line: what; remedy", one a line.
bool read_description(const std::string& path, Description& robot, std::vector<std::string>& errors);

bool read_urdf(const std::string& path, Description& robot, std::vector<std::string>& errors);
/// An MJCF or an .mjb, by MuJoCo's own compiler (tiller_tools.mjcf, in the Python that draws reports).
bool read_mjcf(const std::string& path, Description& robot, std::vector<std::string>& errors);
/// What that compiler says of the file at `path`, as JSON.
bool read_compiled_mjcf(const std::string& json, const std::string& path, Description& robot,
                        std::vector<std::string>& errors);

}  // namespace tiller::tools
