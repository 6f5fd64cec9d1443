#pragma once

// Soft bounds of states: their value and their second order.

#include "rollout/cost.hpp"
#include "rollout/model_adapter.hpp"

namespace tiller {

/// sum_i b_i max(0, low_i - x_i, x_i - high_i)^2.
template <class Model, class S, class T>
TILLER_INLINE S bounds_cost(const Model& model, const CostTerms<T>& cost, const typename Model::template State<S>& x) {
  S sum = S(0.0);
  each(model.nx(), [&](auto i) {
    const S outside = max(max(S(cost.low[i]) - x[i], x[i] - S(cost.high[i])), S(0.0));
    sum = sum + S(cost.bound[i]) * outside * outside;
  });
  return sum;
}

template <class S, class E>
TILLER_INLINE void expand_bounds(const CostTerms<double>& cost, int nx, const S* x, E& e) {
  for (int i = 0; i < nx; ++i) {
    if (!(cost.bound[i] > 0.0)) continue;
    const S above = max(x[i] - S(cost.high[i]), S(0.0)), below = max(S(cost.low[i]) - x[i], S(0.0));
    const S outside = above - below, twice = S(2.0 * cost.bound[i]);
    e.value = e.value + S(cost.bound[i]) * outside * outside;
    e.lx[i] = e.lx[i] + twice * outside;
    e.lxx[i * nx + i] = e.lxx[i * nx + i] + select(above + below > S(0.0), twice, S(0.0));
  }
}

}  // namespace tiller
