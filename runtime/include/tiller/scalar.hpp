#pragma once

#include <cmath>

namespace tiller {

// The functions that a model may call, for one plain number; pack.hpp and dual.hpp have the same for lanes and
// derivatives. A model outside namespace tiller says `using namespace tiller;` to find those that <cmath> lacks.

inline double select(bool m, double a, double b) { return m ? a : b; }
inline double min(double a, double b) { return a < b ? a : b; }
inline double max(double a, double b) { return a > b ? a : b; }
inline double nearest(double a) { return std::nearbyint(a); }
inline void sincos(double x, double& s, double& c) {
  s = std::sin(x);
  c = std::cos(x);
}
inline bool any(bool m) { return m; }
inline bool all(bool m) { return m; }
using std::abs;
using std::atan2;
using std::copysign;
using std::cos;
using std::exp;
using std::floor;
using std::log;
using std::sin;
using std::sqrt;
using std::tanh;

}  // namespace tiller
