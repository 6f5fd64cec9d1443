#include "core/input_cone.hpp"

#include <cmath>

namespace tiller {
namespace {

constexpr bool has(std::uint32_t mask, std::uint32_t i) { return ((mask >> i) & 1u) != 0; }
std::uint32_t axis_bit(const tiller_input_cone_t& cone) { return cone.slope > 0.0 ? 1u << cone.axis : 0u; }

/// Within those cones that have an input in `group`.
bool within_group(const InputCones& cones, std::uint32_t group, const double* u) {
  for (std::uint32_t c = 0; c < cones.count; ++c)
    if ((cones.cone[c].inputs & group) != 0 && !(cone_norm(cones.cone[c], u) <= cone_radius(cones.cone[c], u)))
      return false;
  return true;
}

bool within_steps(std::uint32_t inputs, std::uint32_t group, const double* last, const double* step, const double* u) {
  for (std::uint32_t i = 0; i < inputs; ++i)
    if (has(group, i) && std::fabs(u[i] - last[i]) > step[i]) return false;
  return true;
}

/// The largest share of the way from `last` to `u` that every step of the group allows.
double allowed_share(std::uint32_t inputs, std::uint32_t group, const double* last, const double* step,
                     const double* u) {
  double share = 1.0;
  for (std::uint32_t i = 0; i < inputs; ++i) {
    if (!has(group, i)) continue;
    const double change = std::fabs(u[i] - last[i]);
    if (change > step[i]) share = std::fmin(share, step[i] / change);
  }
  return share;
}

/// A share of the way. Rounding may lead a last place outside: less of the way then, by 2^-50 at first and twice as
/// much each time, so that what it costs is nothing that counts, and the end is `last` itself.
void go_partly(const InputCones& cones, std::uint32_t inputs, std::uint32_t group, const double* last,
               const double* step, double share, double* u) {
  constexpr int kTries = 50;
  const bool starts_within = within_group(cones, group, last);
  double wanted[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < inputs; ++i) wanted[i] = u[i];
  for (int t = 0; t <= kTries; ++t) {
    for (std::uint32_t i = 0; i < inputs; ++i) {
      if (!has(group, i)) continue;
      // between the two, whatever the rounding: both are within the limits
      const double at = last[i] + share * (wanted[i] - last[i]);
      u[i] = std::fmin(std::fmax(at, std::fmin(last[i], wanted[i])), std::fmax(last[i], wanted[i]));
    }
    if (within_steps(inputs, group, last, step, u) && (!starts_within || within_group(cones, group, u))) return;
    share = t < kTries - 1 ? share * (1.0 - std::ldexp(1.0, t - kTries)) : 0.0;
  }
}

}  // namespace

InputCones make_input_cones(const tiller_input_cone_t* cones, std::uint32_t count) {
  InputCones made;
  made.count = count < TILLER_MAX_INPUT_CONES ? count : TILLER_MAX_INPUT_CONES;
  for (std::uint32_t c = 0; c < made.count; ++c) {
    made.cone[c] = cones[c];
    std::uint32_t tied = cones[c].inputs | axis_bit(cones[c]);
    std::uint32_t kept = 0;
    for (std::uint32_t g = 0; g < made.group_count; ++g) {
      if ((made.group[g] & tied) != 0)
        tied |= made.group[g];
      else
        made.group[kept++] = made.group[g];
    }
    made.group[kept] = tied;
    made.group_count = kept + 1;
  }
  return made;
}

double cone_norm(const tiller_input_cone_t& cone, const double* u) {
  double squares = 0.0;
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i)
    if (has(cone.inputs, i)) squares += u[i] * u[i];
  return std::sqrt(squares);
}

double cone_radius(const tiller_input_cone_t& cone, const double* u) {
  return cone.slope > 0.0 ? cone.limit + cone.slope * u[cone.axis] : cone.limit;
}

bool within_cones(const InputCones& cones, const double* u) { return within_group(cones, ~0u, u); }

void shrink_to_cones(const InputCones& cones, double* u) {
  for (std::uint32_t c = 0; c < cones.count; ++c) {
    const tiller_input_cone_t& cone = cones.cone[c];
    const double radius = std::fmax(0.0, cone_radius(cone, u));
    double norm = cone_norm(cone, u), scale = radius / norm;
    // the scaled norm is rounded: where that went outwards, every input takes its next number towards 0
    for (; norm > radius; norm = cone_norm(cone, u), scale = 1.0)
      for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i)
        if (has(cone.inputs, i)) u[i] = scale < 1.0 ? u[i] * scale : std::nextafter(u[i], 0.0);
  }
}

void keep_cones(const InputCones& cones, std::uint32_t inputs, const double* last, const double* step, double* u) {
  shrink_to_cones(cones, u);
  for (std::uint32_t g = 0; g < cones.group_count; ++g) {
    const double share = allowed_share(inputs, cones.group[g], last, step, u);
    if (share < 1.0) go_partly(cones, inputs, cones.group[g], last, step, share, u);
  }
}

}  // namespace tiller
