#pragma once

// The distance from a demonstrated distribution: its value and its second order.

#include "rollout/cost.hpp"
#include "rollout/differences.hpp"

namespace tiller {

/// w / 2 |W (x - mean)|^2; `mean` (nx) and `root` (nx x nx) are the rows that are due.
template <class Model, class S, class T>
TILLER_INLINE S demonstration_cost(const Model& model, const CostTerms<T>& cost, const double* mean, const double* root,
                                   const typename Model::template State<S>& x) {
  const int nx = static_cast<int>(model.nx());
  S d[TILLER_MAX_STATES];
  each(model.nx(),
       [&](auto i) { d[i] = wrapped_difference<Model, S>(model, i, x[i], S(table_value<T>(model, i, mean[i]))); });
  S sum = S(0.0);
  for (int r = 0; r < nx; ++r) {
    S row = S(0.0);
    for (int c = 0; c < nx; ++c) row = row + S(static_cast<T>(root[r * nx + c])) * d[c];
    sum = sum + row * row;
  }
  return S(static_cast<T>(0.5)) * S(cost.demonstration_weight) * sum;
}

/// w / 2 |W d|^2; root(r, c) is W of the row that is due.
template <int kX, class S, class Root, class E>
TILLER_INLINE void expand_demonstration(double weight, int nx, const S* d, const Root& root, E& e) {
  for (int r = 0; r < nx; ++r) {
    S row[kX], residual = S(0.0);
    for (int c = 0; c < nx; ++c) {
      row[c] = root(r, c);
      residual = residual + row[c] * d[c];
    }
    e.value = e.value + S(0.5 * weight) * residual * residual;
    for (int c = 0; c < nx; ++c) {
      const S scaled = S(weight) * row[c];
      e.lx[c] = e.lx[c] + scaled * residual;
      for (int k = 0; k < nx; ++k) e.lxx[c * nx + k] = e.lxx[c * nx + k] + scaled * row[k];
    }
  }
}

}  // namespace tiller
