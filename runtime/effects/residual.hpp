#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Physics that has no name: force = sum_i force_i phi_i(q, v), linear in nine forces that are learnt, with features
/// whose centre and widths are set once (tools/gap/residual/fallback.hpp finds them from logs).
///
/// The features are local: four bumps b_i over the position times two steps over the velocity (backward, forward),
/// normalised, and one feature for everywhere else, so that they sum to one:
///
///     phi_i- = C (1 - s) b_i / B,   phi_i+ = C s b_i / B,   phi_outside = 1 - C,   B = sum b_i
///     b_i = max(0, 1 - (d_i / 1.5)^2)^2 max(0, 1 - (v / reach)^2)^2,   s = (1 + v / sqrt(v^2 + scale^2)) / 2
///     d_i = P / (pi spacing) sin(pi (q - c_i) / P),   c_i = centre + (-1.5, -0.5, 0.5, 1.5) spacing
///     C = 3 t^2 - 2 t^3,   t = min(1, B / 0.3)
///
/// So the force is bounded by the largest |force_i|, has period P (2 pi for an angle; for a sliding joint any P far
/// beyond its travel) and depends on each force_i only near the states that taught it. Under independent normal priors
/// of deviation t, states far from all data have the force N(0, t^2) whatever was learnt elsewhere: the uncertainty
/// widens where data are absent, and the mean goes back to nothing. Random Fourier features (Rahimi and Recht 2007)
/// have no such guarantee: nine of them are all determined by much data of one region, and wave on beyond it.
///
/// Explicit: the force of the step's beginning acts through it. A difference d between backward and forward force is a
/// damping of d / (2 scale) at v = 0; keep it below inertia / step.
template <class S>
struct Residual {
  static constexpr Hook hook = Hook::force;
  static constexpr int kPositions = 4;
  static constexpr EffectInfo info = [] {
    constexpr double kInfinite = __builtin_huge_val();
    EffectInfo i;
    i.name = "residual";
    i.unnamed = true;
    i.needs_position = true;
    i.param_count = 14;
    i.params[0] = {"position_centre_SI", "m or rad", -kInfinite, kInfinite};
    i.params[1] = {"position_spacing_SI", "m or rad", 0.0, kInfinite, Scale::position};
    i.params[2] = {"position_period_SI", "m or rad", 0.0, kInfinite};
    i.params[3] = {"velocity_scale_SI", "m/s or rad/s", 0.0, kInfinite, Scale::velocity};
    i.params[4] = {"velocity_reach_SI", "m/s or rad/s", 0.0, kInfinite, Scale::velocity};
    const char* names[] = {"force_1_backward_SI", "force_1_forward_SI",  "force_2_backward_SI",
                           "force_2_forward_SI",  "force_3_backward_SI", "force_3_forward_SI",
                           "force_4_backward_SI", "force_4_forward_SI",  "force_outside_SI"};
    for (int k = 0; k < 9; ++k) i.params[5 + k] = {names[k], "N or N m", -kInfinite, kInfinite, Scale::force};
    i.help = "learnt force over position and velocity, for physics that has no name; set its widths by tiller gap";
    i.equation = "force = sum of force_i phi_i(q, v); phi: 4 positions x 2 directions, and outside of them";
    i.source = "Moody and Darken (1989), normalised radial basis functions";
    return i;
  }();

  static S force(const JointStep<S>& in, const S* p) {
    constexpr double kPi = 3.14159265358979323846;
    // zero widths (the effect switched off) are as good as narrow ones
    const S spacing = max(p[1], S(1e-6)), period = select(p[2] > S(0.0), p[2], S(1.0));
    const S scale = max(p[3], S(1e-6)), reach = max(p[4], S(1e-6));
    const S one = S(1.0), turn = S(kPi) / period;
    S sine, cosine, s1, c1;
    sincos((in.position - p[0]) * turn, sine, cosine);
    sincos(S(0.5) * spacing * turn, s1, c1);
    // half a spacing thrice, by addition
    const S s3 = s1 * (S(3.0) - S(4.0) * s1 * s1), c3 = c1 * (one - S(4.0) * s1 * s1);
    const S to_spacings = one / (S(1.5) * turn * spacing);
    const S chord[kPositions] = {sine * c3 + cosine * s3, sine * c1 + cosine * s1, sine * c1 - cosine * s1,
                                 sine * c3 - cosine * s3};
    const S v = in.velocity, far = v / reach, near = max(one - far * far, S(0.0));
    const S within = near * near;
    const S forward = S(0.5) + S(0.5) * v / sqrt(v * v + scale * scale);
    constexpr double kCovered = 0.3;
    S sum = S(0.0), total = S(0.0);
    for (int i = 0; i < kPositions; ++i) {
      const S d = chord[i] * to_spacings, left = max(one - d * d, S(0.0));
      const S bump = left * left * within;
      sum = sum + bump;
      total = total + bump * (p[5 + 2 * i] + (p[6 + 2 * i] - p[5 + 2 * i]) * forward);
    }
    const S t = min(sum * (1.0 / kCovered), one), ramp = t * (S(3.0) - S(2.0) * t);
    // C / B = t (3 - 2 t) / max(B, 0.3), which has no pole
    return ramp / max(sum, S(kCovered)) * total + (one - t * ramp) * p[5 + 2 * kPositions];
  }
};

}  // namespace tiller
