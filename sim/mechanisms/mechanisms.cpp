#include "sim/mechanisms/mechanism.hpp"

namespace tiller::sim {

const std::vector<MechanismInfo>& mechanisms() {
  static const std::vector<MechanismInfo> all = {pendulum_info(),         cart_pole_info(),    acrobot_info(),
                                                 planar_quadrotor_info(), two_link_arm_info(), linear_axis_info(),
                                                 skid_steer_info(),       pusher_slider_info(), furuta_info(),
                                                 hopper_info(),           quadrotor_info()};
  return all;
}

const MechanismInfo* find_mechanism(const std::string& kind) {
  for (const MechanismInfo& info : mechanisms()) {
    if (info.kind == kind) return &info;
  }
  return nullptr;
}

}  // namespace tiller::sim
