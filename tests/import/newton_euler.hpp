#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/description/description.hpp"

namespace tiller_test {

/// Inverse dynamics of a description in the world's own frame, link by link as the file has them: what the importer
/// does (merged links, frames of its own, recursions in bodies' axes) is nowhere in it.
class NewtonEuler {
 public:
  explicit NewtonEuler(const tiller::tools::Description& robot) : robot_(robot) {}

  using Values = std::map<std::string, double>;  // by joint

  /// Forces of the joints (Newton and Euler about each joint's axis), gravity in world axes; armature included.
  Values forces(const Values& q, const Values& v, const Values& a, const tiller::tools::Vec3<double>& gravity) const;
  /// Where a link's origin stands.
  tiller::tools::Vec3<double> origin_of(const std::string& link, const Values& q) const;

 private:
  struct Moving;
  std::map<std::string, Moving> all(const Values& q, const Values& v, const Values& a) const;

  const tiller::tools::Description& robot_;
};

}  // namespace tiller_test
