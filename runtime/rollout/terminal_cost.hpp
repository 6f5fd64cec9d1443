#pragma once

// The matrix at the end of the horizon (lay_out_cost): its value and its second order.

#include "rollout/cost.hpp"
#include "rollout/model_adapter.hpp"

namespace tiller {

/// d' P d.
template <class Model, class S, class T>
TILLER_INLINE S cost_to_go(const Model& model, const CostTerms<T>& cost, const typename Model::template State<S>& d) {
  const int nx = static_cast<int>(model.nx());
  S difference[TILLER_MAX_STATES];
  each(model.nx(), [&](auto i) { difference[i] = d[i]; });
  S sum = S(0.0);
  for (int r = 0; r < nx; ++r) {
    S row = S(0.0);
    for (int c = 0; c < nx; ++c) row = row + S(cost.cost_to_go[r * nx + c]) * difference[c];
    sum = sum + difference[r] * row;
  }
  return sum;
}

template <class S, class E>
TILLER_INLINE void expand_cost_to_go(const CostTerms<double>& cost, int nx, const S* d, E& e) {
  for (int r = 0; r < nx; ++r) {
    S half = S(0.0);
    for (int c = 0; c < nx; ++c) {
      half = half + S(cost.cost_to_go[r * nx + c]) * d[c];
      e.lxx[r * nx + c] = e.lxx[r * nx + c] + S(2.0 * cost.cost_to_go[r * nx + c]);
    }
    e.value = e.value + half * d[r];
    e.lx[r] = e.lx[r] + S(2.0) * half;
  }
}

}  // namespace tiller
