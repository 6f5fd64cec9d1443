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
  int line = 0;
  bool has_inertia = false;
  RigidBody body;  ///< in the link's frame
};

enum class JointKind { fixed, revolute, continuous, prismatic, floating, planar };

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
  std::string mimics;                                       ///< the joint that this one follows; empty: none
  double mimic_ratio = 1.0, mimic_offset = 0.0;
};

struct Description {
  std::string path, name;
  std::vector<LinkText> links;
  std::vector<JointText> joints;
  std::vector<std::string> notes;  ///< "file:line: what was left out, and why"
};

/// Reads a URDF. False with every problem in `errors`, "file:line: what; remedy", one a line.
bool read_urdf(const std::string& path, Description& robot, std::vector<std::string>& errors);

}  // namespace tiller::tools
