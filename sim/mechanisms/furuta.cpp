#include "sim/mechanisms/tree.hpp"

namespace tiller::sim {
namespace {

/// An arm on a vertical axis, along +x at 0, and a pendulum on a hinge along the arm at its end. ODE has both as bodies
/// in space; the tree steps them.
std::shared_ptr<const Tree> make_tree(const std::map<std::string, double>& p) {
  const double arm_inertia = p.at("arm_inertia_kgm2"), arm_moment = p.at("arm_moment_kgm");
  const double length = p.at("arm_length_m");
  Tree tree;
  tree.name = "furuta";

  // on its axis, an arm is felt by inertia and moment alone; any mass with both will do
  TreeLink arm;
  arm.name = "arm";
  arm.mass_kg = arm_moment > 0 ? 2 * arm_moment * arm_moment / arm_inertia : arm_inertia / (length * length);
  arm.com_m = {arm_moment / arm.mass_kg, 0, 0};
  const double own = arm_inertia - arm_moment * arm_moment / arm.mass_kg;
  arm.inertia_kgm2 = {own, 0, 0, 0, own, 0, 0, 0, own};

  TreeLink pendulum;
  pendulum.name = "pendulum";
  pendulum.mass_kg = p.at("pendulum_mass_kg");
  pendulum.com_m = {0, 0, -p.at("pendulum_com_m")};
  const double across = p.at("pendulum_inertia_kgm2"), along = p.at("pendulum_axial_kgm2");
  pendulum.inertia_kgm2 = {across, 0, 0, 0, across, 0, 0, 0, along};
  tree.links = {arm, pendulum};

  TreeJoint motor;
  motor.kind = TreeJoint::Kind::revolute;
  motor.name = "arm";
  motor.child = 0;
  motor.position = "arm_rad";
  motor.rate = "arm_rad_s";
  motor.command = "arm_Nm";
  TreeJoint hinge = motor;
  hinge.name = "pendulum";
  hinge.parent = 0;
  hinge.child = 1;
  hinge.origin_m = {length, 0, 0};
  hinge.axis = {1, 0, 0};
  hinge.driven = false;
  hinge.position = "pendulum_rad";
  hinge.rate = "pendulum_rad_s";
  tree.joints = {motor, hinge};

  tree.payload_link = 1;
  tree.payload_m = {0, 0, -p.at("pendulum_length_m")};
  return std::make_shared<const Tree>(std::move(tree));
}

}  // namespace

MechanismInfo furuta_info() {
  // Quanser's QUBE-Servo 2: arm of 0.095 kg and 0.085 m, pendulum of 0.024 kg and 0.129 m, both as uniform rods
  const std::map<std::string, double> rods = {{"arm_length_m", 0.085},
                                              {"arm_inertia_kgm2", 2.34e-4},
                                              {"arm_moment_kgm", 0.00404},
                                              {"pendulum_mass_kg", 0.024},
                                              {"pendulum_length_m", 0.129},
                                              {"pendulum_com_m", 0.0645},
                                              {"pendulum_inertia_kgm2", 3.33e-5},
                                              {"pendulum_axial_kgm2", 1e-9}};
  MechanismInfo info = tree_info(make_tree(rods));
  info.kind = "furuta";
  info.help =
      "a motor turns a level arm about the vertical, a pendulum swings about the arm's direction at its end; pendulum "
      "0 hangs, and it is positive on the side to which a positive arm moves (counter-clockwise from above)";
  info.parameters = {
      {"arm_length_m", rods.at("arm_length_m"), 0, false, "axis to the pendulum's hinge"},
      {"arm_inertia_kgm2", rods.at("arm_inertia_kgm2"), 0, false, "of arm and rotor about the axis"},
      {"arm_moment_kgm", rods.at("arm_moment_kgm"), 0, true, "the arm's mass times the distance of its centre"},
      {"pendulum_mass_kg", rods.at("pendulum_mass_kg"), 0, false, "mass of the pendulum"},
      {"pendulum_length_m", rods.at("pendulum_length_m"), 0, false, "hinge to tip, where a payload is"},
      {"pendulum_com_m", rods.at("pendulum_com_m"), 0, false, "hinge to the pendulum's centre of mass"},
      {"pendulum_inertia_kgm2", rods.at("pendulum_inertia_kgm2"), 0, false, "across, about its centre of mass"},
      {"pendulum_axial_kgm2", rods.at("pendulum_axial_kgm2"), 0, false, "of the pendulum about its own length"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.build = [](const std::map<std::string, double>& p) { return tree_info(make_tree(p)).build(p); };
  return info;
}

}  // namespace tiller::sim
