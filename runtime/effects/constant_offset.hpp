#pragma once

#include "effects/effect_info.hpp"

namespace tiller {

/// A constant force at a joint: an unbalanced load, a cable's pull, a sensor's or amplifier's offset in torque.
template <class S>
struct ConstantOffset {
  static constexpr Hook hook = Hook::force;
  static constexpr EffectInfo info = {
      "constant_offset", PortKind::joint,         1, {"force_SI"},
      {"N or N m"},      {-__builtin_huge_val()}, 0, "a constant force or torque at the joint"};
  static S force(const S&, const S&, const S* p) { return p[0]; }
};

}  // namespace tiller
