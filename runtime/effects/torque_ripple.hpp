#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The drive force swings with the position: a motor whose torque constant does. Two harmonics.
template <class S>
struct TorqueRipple {
  static constexpr Hook hook = Hook::elastic;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "torque_ripple";
    i.param_count = 5;
    i.params[0] = {"cosine", "1", -1.0, 1.0, Scale::none, 2, {0.1, 0.0}};
    i.params[1] = {"sine", "1", -1.0, 1.0, Scale::none, 2, {0.0, 0.1}};
    i.params[2] = {"cosine2", "1", -1.0, 1.0, Scale::none, 2, {0.02, 0.02}};
    i.params[3] = {"sine2", "1", -1.0, 1.0, Scale::none, 2, {0.02, 0.02}};
    i.params[4] = {"spatial_period_SI", "m or rad", 0.005, 6.4, Scale::spatial_period, 0, {}};
    i.needs_drive = true;
    i.needs_position = true;
    i.help = "the drive force swings with the position";
    i.equation = "force = drive (c cos a + s sin a + c2 cos 2a + s2 sin 2a), a = 2 pi q / spatial_period";
    i.source =
        "Jahns, Soong (1996), Pulsating torque minimization techniques for permanent magnet AC motor drives, IEEE TIE 43";
    i.aliases[0] = "cogging";
    i.aliases[1] = "actuator_gain";
    i.separation = "slow motion at two drive forces: ripple goes with the force, cogging does not";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    S sine, cosine;
    sincos(phase(in.middle, p[4]), sine, cosine);
    const S cosine2 = cosine * cosine - sine * sine, sine2 = S(2.0) * sine * cosine;
    return in.drive * (p[0] * cosine + p[1] * sine + p[2] * cosine2 + p[3] * sine2);
  }
};

}  // namespace tiller
