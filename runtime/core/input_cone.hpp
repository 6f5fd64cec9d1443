#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

// Second-order cones of inputs, sqrt(sum over a norm of u_i^2) <= limit + slope * u_axis, in one place: the output gate
// and every planner project through these functions, in numbers or in lanes. An axis stands in no norm
// (tiller_config_check), so a projection leaves every axis where the limits have put it, and shrinking an input for one
// cone cannot break another: any order of cones ends within all of them.

/// The cones of a configuration as projections read them. Plain data: code for lanes is compiled once per instruction
/// set and must not share inline functions.
struct InputCones {
  std::uint32_t count = 0;
  tiller_input_cone_t cone[TILLER_MAX_INPUT_CONES] = {};
  // Inputs that cones tie together, norms and axes; cones that share one are in one group.
  std::uint32_t group_count = 0;
  std::uint32_t group[TILLER_MAX_INPUT_CONES] = {};
};

InputCones make_input_cones(const tiller_input_cone_t* cones, std::uint32_t count);

/// Both sides of the inequality for inputs `u`.
double cone_norm(const tiller_input_cone_t& cone, const double* u);
double cone_radius(const tiller_input_cone_t& cone, const double* u);
/// Whether cone_norm <= cone_radius for every cone, in doubles as they come out. Against exact arithmetic that is
/// right to (n + 3) 2^-53 of the norm and 2^-52 of limit + slope |u_axis|, n inputs in the norm.
bool within_cones(const InputCones& cones, const double* u);

/// Shrinks every norm that is too large onto its cone, radially: the nearest point for this value of the axis. `u` is
/// within cones afterwards in the sense of within_cones, and stays where it is if it was before. Continuous in `u`. A
/// NaN stays one. Needs a radius that is not negative, which the limits of the axis warrant.
void shrink_to_cones(const InputCones& cones, double* u);

/// The same with rate limits: `u` is within the limits and within `step` of `last` (inf: no limit), and `last` within
/// limits and cones (where it is not, to rounding, the result is not either). Where shrinking asks an input for a
/// larger change than its step, all inputs of its group go from `last` towards the shrunk ones, as far as every step
/// allows; limits, steps and cones are convex, so all hold there. Idempotent, and continuous where every step is above
/// 0.
void keep_cones(const InputCones& cones, std::uint32_t inputs, const double* last, const double* step, double* u);

// ---- in lanes: S is a pack ----------------------------------------------------------------------

/// shrink_to_cones to the rounding of S: a lane may end 4 units of its last place outside. `u` (inputs).
template <class S>
void shrink_lanes(const InputCones& cones, int inputs, S* u) {
  for (std::uint32_t c = 0; c < cones.count; ++c) {
    const tiller_input_cone_t& cone = cones.cone[c];
    S squares(0.0), radius(cone.limit);
    for (int i = 0; i < inputs; ++i)
      if ((cone.inputs >> i) & 1u) squares = squares + u[i] * u[i];
    if (cone.slope > 0.0) radius = max(S(0.0), radius + S(cone.slope) * u[cone.axis]);
    const S norm = sqrt(squares);
    const auto beyond = norm > radius;  // false for a NaN, which comes through
    const S scale = select(beyond, radius / select(beyond, norm, S(1.0)), S(1.0));
    for (int i = 0; i < inputs; ++i)
      if ((cone.inputs >> i) & 1u) u[i] = u[i] * scale;
  }
}

/// keep_cones to the rounding of S. `last`, `step`, `u` (inputs).
template <class S, class T>
void keep_lanes(const InputCones& cones, int inputs, const S* last, const T* step, S* u) {
  shrink_lanes(cones, inputs, u);
  for (std::uint32_t g = 0; g < cones.group_count; ++g) {
    S share(1.0);
    for (int i = 0; i < inputs; ++i) {
      if (((cones.group[g] >> i) & 1u) == 0) continue;
      const S change = abs(u[i] - last[i]), most(step[i]);
      const auto beyond = change > most;
      share = min(share, select(beyond, most / select(beyond, change, S(1.0)), S(1.0)));
    }
    const auto partly = share < S(1.0);
    for (int i = 0; i < inputs; ++i)
      if ((cones.group[g] >> i) & 1u) u[i] = select(partly, last[i] + share * (u[i] - last[i]), u[i]);
  }
}

}  // namespace tiller
