#pragma once

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

// The functions that a model may call, for one plain number; pack.hpp and dual.hpp have the same for lanes and
// derivatives. A model outside namespace tiller says `using namespace tiller;` to find those that <cmath> lacks.

inline double select(bool m, double a, double b) { return m ? a : b; }
inline double min(double a, double b) { return a < b ? a : b; }
inline double max(double a, double b) { return a > b ? a : b; }
inline double nearest(double a) { return std::nearbyint(a); }
inline void sincos(double x, double& s, double& c) {
#if defined(TILLER_REPRODUCIBLE)
  portable::sincos(x, s, c);
#else
  s = std::sin(x);
  c = std::cos(x);
#endif
}
inline bool any(bool m) { return m; }
inline bool all(bool m) { return m; }
using math::atan2;
using math::cos;
using math::exp;
using math::log;
using math::sin;
using math::tanh;
using std::abs;
using std::copysign;
using std::floor;
using std::sqrt;

}  // namespace tiller
