#pragma once

// The saturating term: its value and its second order.

#include "rollout/cost.hpp"
#include "rollout/model_adapter.hpp"

namespace tiller {

/// w (1 - exp(-1/2 sum_i (d_i / width_i)^2)).
template <class Model, class S, class T>
TILLER_INLINE S saturating_cost(const Model& model, const CostTerms<T>& cost,
                                const typename Model::template State<S>& d) {
  S sum = S(0.0);
  each(model.nx(), [&](auto i) {
    const S z = d[i] * S(cost.inverse_width[i]);
    sum = sum + z * z;
  });
  return S(cost.saturating_weight) * (S(1.0) - exp(S(-0.5) * sum));
}

/// w (1 - e^(-q/2)), q = sum (d_i / width_i)^2: gradient w e z with z_i = d_i / width_i^2; of the second derivative
/// w e (diag(1 / width^2) - z z') the first part stays, which is what makes it convex everywhere.
template <class S, class E>
TILLER_INLINE void expand_saturating(const CostTerms<double>& cost, int nx, const S* d, E& e) {
  S q = S(0.0);
  for (int i = 0; i < nx; ++i) {
    const S z = d[i] * S(cost.inverse_width[i]);
    q = q + z * z;
  }
  const S bell = S(cost.saturating_weight) * exp(S(-0.5) * q);
  e.value = e.value + S(cost.saturating_weight) - bell;
  for (int i = 0; i < nx; ++i) {
    const S curvature = bell * S(cost.inverse_width[i] * cost.inverse_width[i]);
    e.lx[i] = e.lx[i] + curvature * d[i];
    e.lxx[i * nx + i] = e.lxx[i * nx + i] + curvature;
  }
}

}  // namespace tiller
