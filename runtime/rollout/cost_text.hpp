#pragma once

// The cost: the quadratic terms, and the sum of all that a state costs. One text for plain numbers, lanes and duals: S
// computes, T is the precision of the terms. Every other term has a file of its own, <term>_cost.hpp, with its value
// and its second order.

#include "rollout/bounds_cost.hpp"
#include "rollout/catalogue_cost.hpp"
#include "rollout/demonstration_cost.hpp"
#include "rollout/differences.hpp"
#include "rollout/saturating_cost.hpp"
#include "rollout/terminal_cost.hpp"

namespace tiller {

/// sum_i weight_i (x_i - target_i)^2. `weight` is Q or Qf.
template <class Model, class S, class T>
TILLER_INLINE S state_cost(const Model& model, const T* target, const T* weight,
                           const typename Model::template State<S>& x) {
  S sum = S(0.0);
  if constexpr (Model::kMayTurn) {
    const auto d = differences<Model, S>(model, x, [&](auto i) { return S(target[i]); });
    each(model.nx(), [&](auto i) { sum = sum + S(weight[i]) * d[i] * d[i]; });
  } else {
    each(model.nx(), [&](auto i) {
      const S difference = wrapped_difference<Model, S>(model, i, x[i], S(target[i]));
      sum = sum + S(weight[i]) * difference * difference;
    });
  }
  return sum;
}

/// (u - centre)' R (u - centre) + du' S du.
template <class Model, class S, class T>
TILLER_INLINE S input_cost(const Model& model, const CostTerms<T>& cost, const typename Model::template Input<S>& u,
                           const typename Model::template Input<S>& before) {
  S sum = S(0.0);
  each(model.nu(), [&](auto i) {
    const S change = u[i] - before[i], off = u[i] - S(cost.input_centre[i]);
    sum = sum + S(cost.input[i]) * off * off + S(cost.input_rate[i]) * change * change;
  });
  return sum;
}

/// The cost of limits: a sum of its own where their weights would swallow the digits of every other term.
template <class Model, class S, class T>
TILLER_INLINE S penalty_cost(const Model& model, const CostTerms<T>& cost, const typename Model::template State<S>& x) {
  return bounds_cost<Model, S>(model, cost, x) + catalogue_cost<Model, S>(model, cost, 0, cost.penalty_count, x);
}

/// x - t with the target or the reference's row that is due, angles wrapped.
template <class Model, class S, class T>
TILLER_INLINE typename Model::template State<S> from_target(const Model& model, const CostTerms<T>& cost,
                                                            std::uint64_t step,
                                                            const typename Model::template State<S>& x) {
  const double* row = nullptr;
  if (cost.has(kCostReference))
    row = cost.reference + cost_row(step, cost.reference_rows) * static_cast<std::size_t>(static_cast<int>(model.nx()));
  return differences<Model, S>(model, x,
                               [&](auto i) { return S(row ? table_value<T>(model, i, row[i]) : cost.target[i]); });
}

/// Everything that a state costs at time row `step` but the own cost; `weight` is Q or Qf.
template <class Model, class S, class T>
TILLER_INLINE S every_state_cost(const Model& model, const CostTerms<T>& cost, const T* weight, std::uint64_t step,
                                 const typename Model::template State<S>& x) {
  const auto d = from_target<Model, S>(model, cost, step, x);
  S sum = S(0.0);
  each(model.nx(), [&](auto i) { sum = sum + S(weight[i]) * d[i] * d[i]; });
  if (cost.has(kCostSaturating)) sum = sum + saturating_cost<Model, S>(model, cost, d);
  if (cost.has(kCostBounds)) sum = sum + bounds_cost<Model, S>(model, cost, x);
  if (cost.has(kCostPenaltyTerms)) sum = sum + catalogue_cost<Model, S>(model, cost, 0, cost.penalty_count, x);
  if (cost.has(kCostOtherTerms))
    sum = sum + catalogue_cost<Model, S>(model, cost, cost.penalty_count, cost.term_count, x);
  if (cost.has(kCostDemonstration)) {
    const std::size_t nx = static_cast<std::size_t>(static_cast<int>(model.nx()));
    const std::size_t row = cost_row(step, cost.demonstration_rows);
    sum = sum + demonstration_cost<Model, S>(model, cost, cost.demonstration_mean + row * nx,
                                             cost.demonstration_root + row * nx * nx, x);
  }
  return sum;
}

/// The end of the horizon: Qf in the place of Q, and the cost-to-go.
template <class Model, class S, class T>
TILLER_INLINE S every_terminal_cost(const Model& model, const CostTerms<T>& cost, std::uint64_t step,
                                    const typename Model::template State<S>& x) {
  const S sum = every_state_cost<Model, S>(model, cost, cost.terminal, step, x);
  if (!cost.has(kCostToGo)) return sum;
  return sum + cost_to_go<Model, S>(model, cost, from_target<Model, S>(model, cost, step, x));
}

}  // namespace tiller
