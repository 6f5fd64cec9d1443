#pragma once

// The cost to second order, term by term, with the convex choices that QuadratiseJob states: one text for lanes (a lane
// per step) and for plain numbers.

#include "rollout/cost_text.hpp"
#include "rollout/expansion.hpp"

namespace tiller {

/// expand_states() of a model with quaternions: what is written by differences first, then the derivatives by states.
/// Their second derivatives are left out (Gauss and Newton). There are no demonstrations (tiller_config_check).
template <int kX, class Model, class S, class Due, class E>
TILLER_INLINE void expand_turning(const Model& model, const CostTerms<double>& cost, const double* weight,
                                  const Due& due, const typename Model::template State<S>& state, E& e) {
  const int nx = static_cast<int>(model.nx());
  S x[kX], d[kX];
  const auto target = [&](auto i) {
    const int k = static_cast<int>(i);
    return cost.has(kCostReference) ? due(cost.reference, cost.reference_rows, nx, k) : S(cost.target[k]);
  };
  const auto off = differences<Model, S>(model, state, target);
  each(model.nx(), [&](auto i) {
    const int k = static_cast<int>(i);
    x[k] = state[i];
    d[k] = off[i];
    e.value = e.value + S(weight[k]) * d[k] * d[k];
    e.lx[k] = e.lx[k] + S(2.0 * weight[k]) * d[k];
    e.lxx[k * nx + k] = e.lxx[k * nx + k] + S(2.0 * weight[k]);
  });
  if (cost.has(kCostSaturating)) expand_saturating<S>(cost, nx, d, e);
  if (cost.has(kCostToGo) && weight == cost.terminal) expand_cost_to_go<S>(cost, nx, d, e);
  expand_turns<Model, S>(model, state, target, e.lx, e.lxx);
  if (cost.has(kCostBounds)) expand_bounds<S>(cost, nx, x, e);
  if (cost.has(kCostPenaltyTerms) || cost.has(kCostOtherTerms)) expand_catalogue<S>(cost, nx, x, e);
}

/// All that a state costs but an own cost; `weight` is Q or Qf. due(table, rows, count, index) is entry `index` of the
/// row of `count` that is due in each lane.
template <int kX, class Model, class S, class Due, class E>
TILLER_INLINE void expand_states(const Model& model, const CostTerms<double>& cost, const double* weight,
                                 const Due& due, const typename Model::template State<S>& state, E& e) {
  const int nx = static_cast<int>(model.nx());
  if constexpr (Model::kMayTurn)
    if (model.quaternions() != 0) return expand_turning<kX, Model, S>(model, cost, weight, due, state, e);
  S x[kX], d[kX];
  each(model.nx(), [&](auto i) {
    const int k = static_cast<int>(i);
    const S target = cost.has(kCostReference) ? due(cost.reference, cost.reference_rows, nx, k) : S(cost.target[k]);
    x[k] = state[i];
    d[k] = wrapped_difference<Model, S>(model, i, state[i], target);
    e.value = e.value + S(weight[k]) * d[k] * d[k];
    e.lx[k] = e.lx[k] + S(2.0 * weight[k]) * d[k];
    e.lxx[k * nx + k] = e.lxx[k * nx + k] + S(2.0 * weight[k]);
  });
  if (cost.has(kCostSaturating)) expand_saturating<S>(cost, nx, d, e);
  if (cost.has(kCostBounds)) expand_bounds<S>(cost, nx, x, e);
  if (cost.has(kCostPenaltyTerms) || cost.has(kCostOtherTerms)) expand_catalogue<S>(cost, nx, x, e);
  if (cost.has(kCostToGo) && weight == cost.terminal) expand_cost_to_go<S>(cost, nx, d, e);
  if (!cost.has(kCostDemonstration)) return;
  const std::uint32_t rows = cost.demonstration_rows;
  each(model.nx(), [&](auto i) {
    const int k = static_cast<int>(i);
    d[k] = wrapped_difference<Model, S>(model, i, state[i], due(cost.demonstration_mean, rows, nx, k));
  });
  const auto root = [&](int r, int c) { return due(cost.demonstration_root, rows, nx * nx, r * nx + c); };
  expand_demonstration<kX, S>(cost.demonstration_weight, nx, d, root, e);
}

template <class Model, class S, class E>
TILLER_INLINE void expand_inputs(const Model& model, const CostTerms<double>& cost,
                                 const typename Model::template Input<S>& u,
                                 const typename Model::template Input<S>& before, E& e) {
  const int nu = static_cast<int>(model.nu());
  each(model.nu(), [&](auto i) {
    const int k = static_cast<int>(i);
    const S off = u[i] - S(cost.input_centre[k]), change = u[i] - before[i];
    const S rate = S(2.0 * cost.input_rate[k]) * change;
    e.value = e.value + S(cost.input[k]) * off * off + S(cost.input_rate[k]) * change * change;
    e.lu[k] = e.lu[k] + S(2.0 * cost.input[k]) * off + rate;
    e.lb[k] = e.lb[k] - rate;
    e.luu[k * nu + k] = e.luu[k * nu + k] + S(2.0 * (cost.input[k] + cost.input_rate[k]));
  });
}

}  // namespace tiller
