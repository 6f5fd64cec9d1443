#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tools/description/description.hpp"
#include "tools/import/contact.hpp"

namespace tiller::tools {

/// What moves: bodies in a tree, parents first, each behind one joint along its own z. Links on fixed joints are parts
/// of the body that carries them.

/// A link's share of a body, in the body's frame.
struct LinkShare {
  std::string link;
  RigidBody body;
};

/// A named frame: a link of the description, or a point of interest on one.
struct NamedFrame {
  std::string name;
  int body = -1;  ///< -1: the base
  Pose pose;      ///< in that body's frame
  bool is_link = true;
};

/// How a joint's frame stands in its parent's: turned by `azimuth` about z, moved along the new x, turned by `tilt`
/// about it, moved along y and z, turned by `turn` about z (Denavit and Hartenberg, with what their four numbers cannot
/// say).
struct JointFrame {
  double azimuth_rad = 0.0, tilt_rad = 0.0, turn_rad = 0.0;
  double x_m = 0.0, y_m = 0.0, z_m = 0.0;
};

struct MovingBody {
  std::string joint;
  int parent = -1;  ///< -1: the base
  bool prismatic = false;
  bool wraps = false;  ///< a whole turn changes nothing
  JointFrame frame;
  std::vector<LinkShare> links;
  double low = 0.0, high = 0.0;  ///< of the joint; infinite: none
  double effort = 0.0, speed = 0.0;
  double damping = 0.0, friction = 0.0, armature = 0.0;
  double stiffness = 0.0, rest = 0.0;  ///< a spring about `rest`
  double start = NAN;                  ///< NaN: nobody says
  double offset = 0.0;                 ///< a constant force
  bool actuated = true;
  DriveLaw law;  ///< with `servos`: what the drive makes of the command
  bool has_goal() const { return law.stiffness > 0.0; }
  /// What the command may be where it is a goal: of the drive, else of the joint.
  double goal_low() const { return std::max(law.low, std::isfinite(low) || std::isfinite(law.low) ? low : -kAnyGoal); }
  double goal_high() const {
    return std::min(law.high, std::isfinite(high) || std::isfinite(law.high) ? high : kAnyGoal);
  }
  static constexpr double kAnyGoal = 3.1416;
  int mimics = -1;  ///< the body whose joint this one follows
  double mimic_ratio = 1.0, mimic_offset = 0.0;
  int line = 0;
};

struct Mechanism {
  std::string name, path;
  std::vector<MovingBody> bodies;
  std::vector<NamedFrame> frames;
  std::vector<ContactPair> contacts;
  Vec3<double> gravity_m_s2{0.0, 0.0, -9.81};             ///< none along y
  std::vector<std::string> notes, left_out, idle_drives;  ///< as the description has them

  /// Indices of the bodies whose joints have states of their own.
  std::vector<int> free_joints() const;
  int find_frame(const std::string& name) const;  ///< -1: none
};

enum class BaseKind { fixed, planar, free };

struct MechanismOptions {
  BaseKind base = BaseKind::fixed;
  bool servos = false;       ///< actuators act by their laws: the input of a position servo is its goal
  bool any_inertia = false;  ///< inertias that no body can have are taken as they are
  /// Joints that do not move, and where they stand: of the description, or of a base that moves (base_yaw).
  struct Held {
    std::string joint;
    double position = 0.0;
  };
  std::vector<Held> held;
  /// Rotor inertias behind the gears, which most descriptions leave out: of one joint, or of every one ("*").
  struct Armature {
    std::string joint;
    double inertia = 0.0;  ///< kgm2 or kg
  };
  std::vector<Armature> armature;
};

/// A pattern ("*_hip") among the held joints becomes the joints of the description that it matches. False with the
/// reason where there are none.
bool expand_held(const Description& robot, MechanismOptions& options, std::vector<std::string>& errors);

/// The smallest set of the joints `names` that one pattern tells and that has `count` or more, for messages: "'*_hip'
/// (4 joints)"; empty: there is none.
std::string pattern_of(const std::vector<std::string>& names, std::size_t count);

/// How fast one unit of force accelerates each joint (bodies), the robot standing at `position` (bodies).
std::vector<double> mobility(const Mechanism& mechanism, const std::vector<double>& position);

/// The position (bodies) that a robot begins at: the description's, else 0 where the joints' limits allow, else their
/// middle.
std::vector<double> start_position(const Mechanism& mechanism);

/// Builds the tree. False with every problem in `errors`, "file:line: what; remedy".
bool build_mechanism(const Description& robot, const MechanismOptions& options, Mechanism& mechanism,
                     std::vector<std::string>& errors);

}  // namespace tiller::tools
