#pragma once

// The functions of <cmath> that IEEE 754 leaves open: every C library rounds them in its own way. Code of the runtime
// calls them through this namespace; what IEEE 754 fixes to the last bit (sqrt, floor, remainder, ...) comes from std.

#include <cmath>

#if defined(TILLER_REPRODUCIBLE)
#include "tiller/portable_math.hpp"
#endif

namespace tiller::math {

#if defined(TILLER_REPRODUCIBLE)
using namespace portable;
#else
using std::atan2;
using std::cos;
using std::erfc;
using std::exp;
using std::expm1;
using std::hypot;
using std::log;
using std::pow;
using std::sin;
using std::tanh;
#endif

}  // namespace tiller::math
