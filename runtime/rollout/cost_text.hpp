#pragma once

// The cost's formulas: one text for plain numbers, lanes and duals. S computes, T is the precision of the terms.

#include <cmath>

#include "rollout/cost.hpp"
#include "rollout/model_adapter.hpp"
#include "rollout/quaternion.hpp"

namespace tiller {

/// A table's value of state i in the precision of the terms. Whole turns of an angle make no difference to what is
/// wrapped and would cost single precision its digits; up to 16 of them (turns.hpp) it stays as it is.
template <class T, class Model, class I>
TILLER_INLINE T table_value(const Model& model, I i, double value) {
  if (model.is_angle(i) && (value > 100.53096491487338 || value < -100.53096491487338))
    value -= 6.283185307179586 * std::nearbyint(value * 0.15915494309189535);
  return static_cast<T>(value);
}

/// No cost of one's own beside the model.
template <class S>
struct NoCost {};

/// a - b, wrapped to +-pi where state i is an angle.
template <class Model, class S, class I>
TILLER_INLINE S wrapped_difference(const Model& model, I i, const S& a, const S& b) {
  const S difference = a - b;
  if (!model.is_angle(i)) return difference;
  return difference - S(6.283185307179586) * nearest(difference * S(0.15915494309189535));
}

/// x - b state by state, b(i) being state i of b.
template <class Model, class S, class B>
TILLER_INLINE typename Model::template State<S> differences(const Model& model,
                                                            const typename Model::template State<S>& x, const B& b) {
  typename Model::template State<S> d;
  each(model.nx(), [&](auto i) { d[i] = wrapped_difference<Model, S>(model, i, x[i], b(i)); });
  turn_differences<Model, S>(model, x, b, d);
  return d;
}

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

/// x[index] where the index is known only at run time.
template <class Model, class S>
TILLER_INLINE S pick_state(const Model& model, const typename Model::template State<S>& x, std::uint32_t index) {
  S value = S(0.0);
  each(model.nx(), [&](auto i) {
    if (static_cast<std::uint32_t>(i) == index) value = x[i];
  });
  return value;
}

/// weight max(0, radius - distance)^2 over the obstacles.
template <class Model, class S, class T>
TILLER_INLINE S obstacles_cost(const Model& model, const CostTerms<T>& cost,
                               const typename Model::template State<S>& x) {
  S sum = S(0.0);
  for (std::uint32_t k = 0; k < cost.obstacle_count; ++k) {
    const CostObstacle<T>& o = cost.obstacles[k];
    const S dx = pick_state<Model, S>(model, x, o.x_state) - S(o.x_m);
    const S dy = pick_state<Model, S>(model, x, o.y_state) - S(o.y_m);
    const S depth = max(S(o.radius_m) - sqrt(dx * dx + dy * dy), S(0.0));
    sum = sum + S(o.weight) * depth * depth;
  }
  return sum;
}

/// The cost of limits: a sum of its own where their weights would swallow the digits of every other term.
template <class Model, class S, class T>
TILLER_INLINE S penalty_cost(const Model& model, const CostTerms<T>& cost, const typename Model::template State<S>& x) {
  return bounds_cost<Model, S>(model, cost, x) + obstacles_cost<Model, S>(model, cost, x);
}

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
  if (cost.has(kCostObstacles)) sum = sum + obstacles_cost<Model, S>(model, cost, x);
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
