#pragma once

// A force that fades and swings, as the real part of z: of z now z exp((i turns - fades) t) is left after t.

#include <cstddef>
#include <cstdint>

#include "scalar/inline.hpp"
#include "tiller/math.hpp"

namespace tiller {

/// What a force keeps along itself, and what its imaginary part takes from it.
template <class S>
struct Turn {
  S along, across;
};

TILLER_INLINE Turn<double> turn_after(double fades, double turns, double periods) {
  const double left = math::exp(-fades * periods);
  return {left * math::cos(turns * periods), left * math::sin(turns * periods)};
}

/// Of `count` forces at `force`, `stride` apart, with their imaginary parts behind them.
template <class S>
TILLER_INLINE void turn_forces(const Turn<S>& turn, std::uint32_t count, S* force, std::size_t stride = 1) {
  for (std::uint32_t j = 0; j < count; ++j) {
    S &real = force[j * stride], &imaginary = force[(count + j) * stride];
    const S before = real;
    real = turn.along * before - turn.across * imaginary;
    imaginary = turn.across * before + turn.along * imaginary;
  }
}

}  // namespace tiller
