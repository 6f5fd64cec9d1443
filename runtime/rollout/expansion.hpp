#pragma once

// The cost to second order around one step, which its terms add to.

#include "scalar/inline.hpp"

namespace tiller {

/// Second order around one step; nx and nu are the model's counts, kX and kU their bounds.
template <class S, int kX, int kU>
struct Expansion {
  S value;
  S lx[kX], lu[kU], lb[kU];
  S lxx[kX * kX], luu[kU * kU], lux[kU * kX];

  TILLER_INLINE void clear(int nx, int nu) {
    value = S(0.0);
    for (int i = 0; i < nx; ++i) lx[i] = S(0.0);
    for (int i = 0; i < nu; ++i) lu[i] = lb[i] = S(0.0);
    for (int i = 0; i < nx * nx; ++i) lxx[i] = S(0.0);
    for (int i = 0; i < nu * nu; ++i) luu[i] = S(0.0);
    for (int i = 0; i < nu * nx; ++i) lux[i] = S(0.0);
  }
};

}  // namespace tiller
