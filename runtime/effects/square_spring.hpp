#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A spring whose force goes with the square of the deflection, about position 0: a leaf that rolls onto its seat, a
/// rubber buffer in shear. Implicit midpoint rule: the middle x solves x + y k x |x| = middle, a quadratic.
template <class S>
struct SquareSpring {
  static constexpr Hook hook = Hook::elastic;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "square_spring";
    i.param_count = 1;
    i.params[0] = {
        "stiffness_SI2", "N/m^2 or N m/rad^2", 0.0, __builtin_huge_val(), Scale::force_per_position2, 1, {0.2}};
    i.needs_position = true;
    i.help = "a spring about position 0 whose force goes with the square";
    i.equation = "force = -stiffness q |q|";
    i.source = "Nayfeh, Mook (1979), Nonlinear oscillations, ch. 2";
    i.aliases[0] = "linear_spring";
    i.aliases[1] = "cubic_spring";
    i.separation = "excursions a factor of three apart";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    const S root = sqrt(S(1.0) + S(4.0) * yield(in) * p[0] * abs(in.middle));
    const S x = S(2.0) * in.middle / (S(1.0) + root);
    return -p[0] * x * abs(x);
  }
};

}  // namespace tiller
