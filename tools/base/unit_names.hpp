#pragma once

#include <string>

namespace tiller::tools {

/// The unit that a field's name ends in: "m/s" of velocity_m_s, "N m s" of damping_Nms, "kg m^2" of inertia_kgm2, "1/h"
/// of growth_1_h, "g/L" of sugar_g_L. Empty: the name does not tell ("torque_gain").
std::string unit_of_field(const std::string& name);

}  // namespace tiller::tools
