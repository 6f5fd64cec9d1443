#pragma once

#include <array>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "sim/mechanisms/mechanism.hpp"

namespace tiller::sim {

using Point3 = std::array<double, 3>;
using Rotation3 = std::array<double, 9>;  ///< row by row

/// A rigid body of a tree, in its link's axes.
struct TreeLink {
  std::string name;
  double mass_kg = 0;
  Point3 com_m{};              ///< from the link's origin
  Rotation3 inertia_kgm2{};    ///< about the centre of mass
  std::string mass_parameter;  ///< of the plant: another mass in the same shape; empty: none
};

/// A joint, and with it how the child's frame stands in the parent's.
struct TreeJoint {
  enum class Kind { fixed, revolute, prismatic } kind = Kind::fixed;
  std::string name;
  int parent = -1, child = -1;  ///< links; parent -1: the ground
  Point3 origin_m{};            ///< of the child's frame in the parent's, where the joint stands at 0
  Rotation3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  Point3 axis{0, 0, 1};  ///< unit, in the child's frame
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
  double armature = 0;  ///< kgm2 or kg: the rotor behind the gear
  bool driven = true;
  std::string position, rate, command;  ///< channels: "pan_rad", "pan_rad_s", "pan_Nm"
  std::string gain_parameter;           ///< of the plant: a factor of the command; empty: none
};

/// A robot as a tree of links and joints, joints in the order of the plant's states.
struct Tree {
  std::string name;
  std::vector<TreeLink> links;
  std::vector<TreeJoint> joints;
  int payload_link = -1;  ///< where a payload hangs, and at which of its points; -1: nowhere
  Point3 payload_m{};
};

/// The plant of a tree: one ODE body for each link that moves (links on fixed joints are part of what carries them),
/// one hinge or slider for each joint, gravity along -z. Joints have stops at their ends, hinges where both lie within
/// half a turn.
///
/// Coordinates go half a step, ODE solves for the velocities there, coordinates go the other half: steps of second
/// order, as PlanarMechanism has them. Bodies stand on their joints exactly; the acceleration that comes from turning
/// alone (linear and angular) is handed to ODE as a force, for which d'Alembert stands. An armature is a motor row that
/// keeps the joint's rate with a compliance of step / armature: the implicit form of a force -armature times the
/// acceleration. Nothing of it knows forward dynamics or inverse inertias.
MechanismInfo tree_info(std::shared_ptr<const Tree> tree);

/// Whether ODE can have it: every body that moves needs a mass and inertia. False with the reason.
bool tree_is_possible(const Tree& tree, std::string& why);

}  // namespace tiller::sim
