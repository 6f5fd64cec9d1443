#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// An encoder whose disc or scale runs off its centre: the reading's error repeats with the position. The filters
/// follow it by its slope where they are. While the slope of the whole, 1 + d error / d x, stays positive, each reading
/// belongs to one position.
template <class S>
struct EncoderEccentricity {
  static constexpr Hook hook = Hook::sensor;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "encoder_eccentricity";
    i.port = PortKind::sensor;
    i.param_count = 3;
    i.params[0] = {"cosine_SI", "as the state", -__builtin_huge_val(), __builtin_huge_val(), Scale::none, 1, {0.02}};
    i.params[1] = {"sine_SI", "as the state", -__builtin_huge_val(), __builtin_huge_val(), Scale::none,
                   2,         {0.02, -0.02}};
    i.params[2] = {"spatial_period_SI", "as the state", 0.005, 6.4, Scale::position, 3, {1.5, 3.0, 6.0}};
    i.help = "the sensor's error repeats with the position: an encoder's disc off its centre";
    i.equation = "measured = x + cosine cos(2 pi x / spatial_period) + sine sin(2 pi x / spatial_period)";
    i.aliases[0] = "cogging";
    i.aliases[1] = "sensor_scale";
    i.separation = "a second sensor of the same state, or a slow turn at constant speed";
    return i;
  }();
  static void measure(S& gain, S& offset, const SensorSight<S>& at, const S* p) {
    const S read = gain * at.state + offset, turn = S(6.28318530717958647693) / select(p[2] > S(0.0), p[2], S(1.0));
    S sine, cosine;
    sincos(phase(read, p[2]), sine, cosine);
    gain = gain * (S(1.0) + turn * (p[1] * cosine - p[0] * sine));
    offset = read + p[0] * cosine + p[1] * sine - gain * at.state;
  }
};

}  // namespace tiller
