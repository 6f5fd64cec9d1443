#include "sim/mechanisms/two_rods.hpp"

namespace tiller::sim {

MechanismInfo two_link_arm_info() {
  MechanismInfo info = acrobot_info();
  info.kind = "two_link_arm";
  info.help =
      "two rods hinged to each other and to a fixed shoulder, a motor in each hinge; (0, 0) hangs, counter-clockwise "
      "is positive";
  info.commands = {{"shoulder_Nm", "Nm"}, {"elbow_Nm", "Nm"}};
  info.actuated = 0;
  info.motors = {0, 1};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<TwoRods>(p, std::vector<std::size_t>{0, 1});
  };
  return info;
}

}  // namespace tiller::sim
