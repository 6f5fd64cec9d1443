#pragma once

// The second order of a cost of one's own, and its derivatives where it is a function in C.

#include "rollout/psd.hpp"
#include "scalar/inline.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Adds weight times a cost of one's own, given by value, gradient (n) and Hessian (n x n) over (x, u), with the
/// Hessian's negative eigenvalues clipped; n = nx at the end of the horizon. The Hessian is overwritten.
template <int kN, class S, class E>
TILLER_INLINE void add_own(double weight, int nx, int nu, int n, const S& value, const S* gradient, S* hessian, E& e) {
  clip_negative_eigenvalues<kN>(hessian, n);
  const S w = S(weight);
  e.value = e.value + w * value;
  for (int r = 0; r < nx; ++r) {
    e.lx[r] = e.lx[r] + w * gradient[r];
    for (int c = 0; c < nx; ++c) e.lxx[r * nx + c] = e.lxx[r * nx + c] + w * hessian[r * n + c];
  }
  if (n == nx) return;
  for (int r = 0; r < nu; ++r) {
    const int row = nx + r;
    e.lu[r] = e.lu[r] + w * gradient[row];
    for (int c = 0; c < nu; ++c) e.luu[r * nu + c] = e.luu[r * nu + c] + w * hessian[row * n + nx + c];
    for (int c = 0; c < nx; ++c) e.lux[r * nx + c] = e.lux[r * nx + c] + w * hessian[row * n + c];
  }
}

/// Value, gradient and Hessian of a function in C by central differences: widths of eps^(1/3) and eps^(1/4), relative
/// to the argument where it is above 1. z = (x, u), n of them; the end of the horizon where `stage` is false.
/// 1 + 2 n + 2 n^2 calls.
TILLER_INLINE void difference_own(const tiller_own_cost_t& own, bool stage, int nx, int n, const double* z,
                                  const double* p, double time_s, double& value, double* gradient, double* hessian) {
  double at[TILLER_MAX_STATES + TILLER_MAX_INPUTS];
  const auto call = [&] {
    if (stage) return own.stage(at, at + nx, p, time_s, own.context);
    return own.terminal ? own.terminal(at, p, time_s, own.context) : 0.0;
  };
  const auto width = [&](int i, double relative) {
    const double size = z[i] < 0.0 ? -z[i] : z[i];
    return relative * (size > 1.0 ? size : 1.0);
  };
  for (int i = 0; i < n; ++i) at[i] = z[i];
  value = call();
  for (int i = 0; i < n; ++i) {
    const double narrow = width(i, 6e-6), wide = width(i, 1.2e-4);
    const auto moved = [&](double way) {
      at[i] = z[i] + way;
      const double result = call();
      at[i] = z[i];
      return result;
    };
    gradient[i] = (moved(narrow) - moved(-narrow)) / (2.0 * narrow);
    hessian[i * n + i] = (moved(wide) - 2.0 * value + moved(-wide)) / (wide * wide);
    for (int j = 0; j < i; ++j) {
      const double other = width(j, 1.2e-4);
      double sum = 0.0;
      for (int corner = 0; corner < 4; ++corner) {
        const double si = corner & 1 ? 1.0 : -1.0, sj = corner & 2 ? 1.0 : -1.0;
        at[i] = z[i] + si * wide;
        at[j] = z[j] + sj * other;
        sum += si * sj * call();
      }
      at[i] = z[i];
      at[j] = z[j];
      hessian[i * n + j] = hessian[j * n + i] = sum / (4.0 * wide * other);
    }
  }
}

}  // namespace tiller
