#pragma once

#include <string>
#include <vector>

#include "tools/description/description.hpp"

namespace tiller::tools {

/// A place where two bodies may touch: a sphere (of radius 0: a corner) about a point of body a, and on body b a face
/// or another sphere. A body of -1 is the base.
struct ContactPoint {
  int body_a = -1, body_b = -1;
  Vec3<double> at{};      ///< in a's frame
  double radius_m = 0.0;  ///< about `at`
  Pose face;              ///< in b's frame: the origin on the face, or the sphere's centre; z outwards
  bool is_ball = false;
  double ball_m = 0.0;                                   ///< radius of b's sphere
  double half_x_m = 0.0, half_y_m = 0.0, depth_m = 0.0;  ///< where a face ends; 0: nowhere
};

/// Two shapes with one law.
struct ContactPair {
  std::string name;     ///< of its parameters: "foot"
  std::string spelled;  ///< as on the command line: "foot:plane"
  TouchLaw law;
  double grip_ratio = 1.0;
  double smooth_N = 0.1;  ///< half the width of the corners of maximum and clamp
  std::vector<ContactPoint> points;
};

}  // namespace tiller::tools
