#pragma once

#include "tiller/model.hpp"

/// A cart with two driven wheels, as its drives see it: they keep the speed and the turn rate that they are told, up to
/// a gain that worn or wrongly measured wheels bring. No forces: a kinematic model, so Force and joints are left out.
/// Heading 0 looks along x; counter-clockwise is positive.
template <class S>
struct Unicycle {
  static constexpr const char* name = "unicycle";
  TILLER_FIELDS(State, S, x_m, y_m, heading_rad);
  TILLER_FIELDS(Input, S, speed_m_s, turn_rad_s);
  TILLER_FIELDS(Params, S, speed_gain, turn_gain);
  static constexpr unsigned angles = 1u << 2;

  static State dynamics(const State& x, const Input& u, const tiller::Body<S>&, const Params& p) {
    const S speed = p.speed_gain * u.speed_m_s;
    return {speed * cos(x.heading_rad), speed * sin(x.heading_rad), p.turn_gain * u.turn_rad_s};
  }
};
