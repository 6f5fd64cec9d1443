#include "sim/mechanisms/two_rods.hpp"

namespace tiller::sim {

MechanismInfo acrobot_info() {
  MechanismInfo info;
  info.kind = "acrobot";
  info.help =
      "two rods hinged to each other and to a fixed shoulder, with a motor in the elbow alone; (0, 0) hangs, (pi, 0) "
      "stands, counter-clockwise is positive";
  info.parameters = {
      {"upper_mass_kg", 1.0, 0, false, "mass of the upper rod"},
      {"lower_mass_kg", 1.0, 0, false, "mass of the lower rod"},
      {"upper_length_m", 0.5, 0, false, "shoulder to elbow"},
      {"lower_length_m", 0.5, 0, false, "elbow to tip; no mass is there, so nothing depends on it"},
      {"upper_com_m", 0.25, 0, false, "shoulder to the upper rod's centre of mass"},
      {"lower_com_m", 0.25, 0, false, "elbow to the lower rod's centre of mass"},
      {"upper_inertia_kgm2", 1.0 / 48, 0, false, "of the upper rod about its centre of mass"},
      {"lower_inertia_kgm2", 1.0 / 48, 0, false, "of the lower rod about its centre of mass"},
      {"shoulder_damping_Nms", 0.0, 0, true, "viscous friction of the shoulder"},
      {"elbow_damping_Nms", 0.0, 0, true, "viscous friction of the elbow"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"shoulder_rad", "rad"}, {"elbow_rad", "rad"}, {"shoulder_rad_s", "rad/s"}, {"elbow_rad_s", "rad/s"}};
  info.default_state = {0, 0, 0, 0};
  info.measured = {0, 1};
  info.commands = {{"elbow_Nm", "Nm"}};
  info.joints = {"shoulder", "elbow"};
  info.actuated = 1;
  info.motors = {1};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<TwoRods>(p, std::vector<std::size_t>{1});
  };
  return info;
}

}  // namespace tiller::sim
